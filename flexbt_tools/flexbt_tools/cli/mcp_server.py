# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool mcp``: a server of the Model Context Protocol on standard streams, for language models that write missions.

Each tool runs a command of ``bt_tool`` or ``behavior_tool`` in a process of its own (:mod:`.confined`) with a time
limit. No tool needs, finds or moves a robot. What a model reads are the names, docstrings and fields of the tools.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, Any, BinaryIO, Final, Literal
from xml.etree import ElementTree

import anyio
from mcp.server import MCPServer
from mcp.server.mcpserver.context import Context
from mcp.server.mcpserver.exceptions import ToolError as RefusedCall
from mcp.server.mcpserver.exceptions import UnexpectedToolError
from mcp.types import CallToolResult, InputRequiredResult, ToolAnnotations
from pydantic import Field

from flexbt_core.values.text import did_you_mean, escape_lines, truncate_middle
from flexbt_core.values.text_files import TextFileError, read_text, write_text
from flexbt_core.values.yaml_data import yaml_line
from flexbt_tools.errors import ExitCode

from .confined import MAX_FILE

INSTRUCTIONS: Final = """\
Write robot missions as behavior trees (BehaviorTree.CPP XML, format 4) or state machines (YAML), and check them \
without a robot. Work in this order: list_node_types, write a file, check_tree until no findings are left, run_tree \
with mocks for the cases of the task, prove_tree with the requirements of the task. Do not invent node types, ports \
or skills. A mission whose check and proof are not "ok" is not finished. If a goal can be stated as literals, \
plan_tree writes the tree; if a state machine is wanted, synthesize_machine writes it. Nothing here can move a \
robot: a person starts missions at the operator console."""

MAX_TEXT: Final = 1_000_000
"""Length of a file and of an argument, characters."""
MAX_ANSWER: Final = 100_000
"""Length of an answer, characters; a longer one is shortened to its findings."""
_MAX_ERROR: Final = 5000
_MAX_WORD: Final = 100_000
"""Length of a value, characters: below the limit of Linux for an argument of a process."""
_AT_ONCE: Final = 2
_SUFFIXES: Final = ('.xml', '.yaml', '.yml')
_NO_TEXT: Final = re.compile('[\0\ud800-\udfff]')
"""Characters that no text for a client or a command may have. Names of files that are not UTF-8 have them."""
_WRITING: Final = ('write_file', 'plan_tree', 'synthesize_machine')

File = Annotated[
    str, Field(max_length=500, description='File in the folder of this server, such as "missions/deliver.xml".')
]
TreeFiles = Annotated[
    tuple[File, ...],
    Field(
        max_length=50,
        description='Tree files (XML). The first one has the main tree. Installed trees: "package://PACKAGE/PATH".',
    ),
]
SkillFiles = Annotated[tuple[File, ...], Field(max_length=20, description='YAML files of skills.')]
ModelFiles = Annotated[
    tuple[File, ...],
    Field(max_length=20, description='XML files whose <TreeNodesModel> describes node types that are not installed.'),
]
Word = Annotated[str, Field(max_length=500)]
Faults = Annotated[int, Field(ge=0, le=3, description='Number of servers that may be gone for good.')]
Tree = Annotated[str, Field(max_length=200, description='ID of a tree. Empty: the main tree, or all trees.')]
Behavior = Annotated[
    str, Field(max_length=500, description='Name of an installed behavior, or file of a state machine (YAML).')
]
Requirements = Annotated[
    tuple[Word, ...],
    Field(
        max_length=50,
        description=(
            'Requirements that every run must keep, one per text: "never EVENT", "EVENT at most 3 times", '
            '"EVENT only after EVENT" (optionally ", each time anew"), "after EVENT, EVENT before the end", '
            '"after EVENT, EVENT within 10 s", "A never while B", "A works only while CONDITION holds" (or "fails"), '
            '"EVENT is always still possible", "NAME is a TYPE", "NAME has PORT=TEXT". Events of a tree: "name" (a '
            'leaf starts), "name > SUCCESS", "name > FAILURE", "=SUCCESS", "=FAILURE"; a type stands for all unnamed '
            'leaves of it; in a sub-tree "subtree/name". Events of a machine: "/State" (entered), "/State > outcome", '
            '"=outcome".'
        ),
    ),
]
Status = Literal['SUCCESS', 'FAILURE', 'RUNNING', 'SKIPPED']
Answer = dict[str, Any]
NONE: Final[dict[str, Any]] = {}


class StrictServer(MCPServer[Any]):
    """A server that refuses unknown arguments, and quotes no long ones.

    The SDK ignores unknown arguments, so a misspelled option would have no effect.
    """

    async def call_tool(
        self, name: str, arguments: dict[str, Any], context: Context[Any, Any] | None = None
    ) -> CallToolResult | InputRequiredResult:
        known = {tool.name: tool.input_schema['properties'] for tool in await self.list_tools()}
        if name not in known:
            raise RefusedCall(f'there is no tool {truncate_middle(name)!r}{did_you_mean(name, known)}')
        for word in arguments:
            if word not in known[name]:
                near = did_you_mean(word, known[name], f'; its arguments are: {", ".join(known[name])}')
                raise RefusedCall(f'{name} has no argument {truncate_middle(word)!r}{near}')
        try:
            return await super().call_tool(name, arguments, context)
        except UnexpectedToolError:
            raise
        except RefusedCall as error:
            raise RefusedCall(truncate_middle(str(error), _MAX_ERROR)) from error


@dataclass(frozen=True)
class MissionTools:
    """The tools, for files in ``folder``: each public method is one. Each runs for at most ``seconds``."""

    folder: Path
    seconds: int
    running: anyio.CapacityLimiter

    async def list_files(self) -> list[str]:
        """List the tree, machine and skill files (XML, YAML) in the folder of this server: at most 1000."""
        found: list[str] = []
        for directory, below, names in os.walk(self.folder):
            below[:] = sorted(name for name in below if not name.startswith('.'))
            here = Path(directory).relative_to(self.folder)
            files = (str(here / name) for name in sorted(names) if name.endswith(_SUFFIXES))
            found += [file for file in files if not _NO_TEXT.search(file)]
            if len(found) > 1000:
                break
        return found[:1000]

    async def read_file(self, file: File) -> str:
        """Read a file (XML, YAML) in the folder of this server."""
        try:
            return read_text(self._own(file), MAX_TEXT)
        except TextFileError as error:
            raise RefusedCall(f'{file}: cannot be read: {error}') from error

    async def write_file(self, file: File, text: Annotated[str, Field(max_length=MAX_TEXT)]) -> str:
        """Write a whole tree, machine, mission or skill file (XML, YAML) in the folder of this server. Replaces an
        existing file; creates missing folders. Check it afterwards."""
        path = self._own(file)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, text)
        except (OSError, UnicodeEncodeError) as error:
            raise RefusedCall(f'{file}: cannot be written: {getattr(error, "strerror", None) or error}') from error
        return f'{file}: {len(text)} characters written'

    async def list_node_types(
        self,
        names: Annotated[
            tuple[Word, ...], Field(max_length=50, description='Types to describe with their ports.')
        ] = (),
        search: Annotated[Word, Field(description='Only types with this text in name or description.')] = '',
    ) -> list[Answer]:
        """List the node types that are installed, with kind and description. With names: also their ports (name, type,
        default, meaning). Call it before you write a tree."""
        code, out, err = await self._run('bt_tool', ['model', '--builtin'])
        if code:
            raise RefusedCall(_text(err))
        types = ElementTree.fromstring(out).find('TreeNodesModel')  # noqa: S314 - written by our own command
        known = {one.get('ID', ''): one for one in types or ()}
        for name in names:
            if name not in known:
                raise RefusedCall(f'there is no node type {truncate_middle(name)!r}{did_you_mean(name, known)}')
        found = (_node_type(known[name], with_ports=bool(names)) for name in names or known)
        return [one for one in found if search.lower() in f'{one["name"]} {one["description"]}'.lower()]

    async def list_skills(
        self,
        names: Annotated[tuple[Word, ...], Field(max_length=50, description='Only these skills.')] = (),
        skills: SkillFiles = (),
    ) -> Answer:
        """List what leaves need and bring about (pre-conditions, effects, resources, durations): those that installed
        packages declare, and those of skill files. plan_tree uses them."""
        words = ['skills', '--json', *_options('--skill', names), *self._files(skills)]
        code, out, err = await self._run('bt_tool', words)
        if code not in (ExitCode.OK, ExitCode.NEGATIVE):
            raise RefusedCall(_text(err))
        return _fitting({'skills': json.loads(out), 'notes': _text(err)})

    async def check_tree(
        self,
        files: TreeFiles,
        inputs: Annotated[
            tuple[Word, ...], Field(max_length=50, description='Blackboard keys written from outside.')
        ] = (),
        skills: SkillFiles = (),
        models: ModelFiles = (),
    ) -> Answer:
        """Check tree files: XML, node types, ports, data flow, unreachable nodes, shared actuators. Each finding has
        rule, severity, place (file, line, column, end), message and fix. verdict "ok": no errors; also read the
        warnings."""
        options = [*_options('--input', inputs), *self._options('--skills', skills), *self._options('--models', models)]
        return await self._answer('bt_tool', ['check', '--json', *options, *self._files(files)])

    async def run_tree(
        self,
        files: TreeFiles,
        tree: Tree = '',
        mocks: Annotated[
            dict[Word, Annotated[tuple[Status, ...], Field(max_length=100)]],
            Field(
                max_length=100,
                description=(
                    'Results of leaves by type, name or path, one per activation; the last one is repeated: '
                    '{"FollowPath": ["FAILURE", "SUCCESS"]}. "*" stands for all others. Default: all succeed.'
                ),
            ),
        ] = NONE,
        blackboard: Annotated[
            dict[Word, Any], Field(max_length=100, description='Initial entries of the blackboard.')
        ] = NONE,
        timeout: Annotated[
            float, Field(gt=0, le=86400, description='End of the run on the simulated clock, s.')
        ] = 600.0,
        models: ModelFiles = (),
    ) -> Answer:
        """Run a tree once with mocks in place of all leaves that need a robot, on a simulated clock. Returns the
        result, the reasons of a failure, the blackboard and the status changes (the last 200). One run shows one case;
        prove_tree covers all."""
        # Of patterns that match a leaf the first one counts, so the one for all others is the last.
        given = [*(one for one in mocks.items() if one[0] != '*'), ('*', mocks.get('*', ['SUCCESS']))]
        words = ['run', '--json', f'--timeout={timeout}', *self._options('--models', models)]
        words += _options('--mock', (f'{name}={",".join(steps)}' for name, steps in given))
        words += _options('--set', (f'{name}={yaml_line(value)}' for name, value in blackboard.items()))
        words += _options('--tree', [tree] if tree else [])
        code, out, err = await self._run('bt_tool', [*words, *self._files(files)])
        lines = [json.loads(line) for line in out.splitlines()]
        if not lines:
            raise RefusedCall(_text(err))
        changes = [{k: v for k, v in one.items() if k != 'event'} for one in lines if one.get('event') == 'transition']
        return _fitting({'verdict': _verdict(code), **lines[-1], 'transitions': changes[-200:], 'notes': _text(err)})

    async def prove_tree(
        self,
        files: TreeFiles,
        tree: Tree = '',
        require: Requirements = (),
        given: Annotated[
            tuple[Word, ...], Field(max_length=50, description='Keys on the blackboard before the start.')
        ] = (),
        models: ModelFiles = (),
        faults: Faults = 1,
    ) -> Answer:
        """Explore everything that can happen to a tree (any result of each leaf, stops, dead servers) and report
        deadlocks, endless loops, missing data, conflicts of actuators and broken requirements, each with the shortest
        way to it. verdict "ok": proved; "unfinished": nothing wrong so far, not all was explored; "unreachable":
        nothing goes wrong, but the tree cannot succeed or a node is never reached."""
        words = [f'--faults={faults}', *_options('--given', given), *_options('--tree', [tree] if tree else [])]
        words += [*_options('--require', require), *self._options('--models', models)]
        return await self._prove('bt_tool', words, self._files(files))

    async def draw_tree(self, file: File, tree: Tree = '', expand: bool = False, models: ModelFiles = ()) -> str:
        """Draw the trees of a file as Mermaid text. expand: show sub-trees in place."""
        words = ['draw', '--format', 'mermaid', *(['--expand'] if expand else []), *self._options('--models', models)]
        return await self._text('bt_tool', [*words, *_options('--tree', [tree] if tree else []), *self._files([file])])

    async def plan_tree(
        self,
        mission: File,
        goal: Annotated[
            Word, Field(description='Replaces the goal of the file: "(on(cup, table) | held) & !open(door)".')
        ] = '',
        output: Annotated[str, Field(max_length=500, description='File to write the tree to (.xml).')] = '',
    ) -> Answer:
        """Plan a goal from skills and a start (mission file, YAML: skills, start, goal, disturbances) and return the
        cheapest plan and the reactive tree that carries it out, or why there is none (verdict "negative")."""
        words = ['plan', '--json', '--quiet', f'--time-limit={self._inner()}', *([f'--goal={goal}'] if goal else [])]
        words += [f'--output={self._own(output)}'] if output else []
        return await self._answer('bt_tool', [*words, *self._files([mission])])

    async def check_behavior(
        self, behavior: Behavior, parameters: dict[Word, Word] = NONE, trees: tuple[File, ...] = ()
    ) -> Answer:
        """Check a state machine with the trees that it runs: transitions, userdata, blackboard keys, endless loops.
        parameters: values of the behavior's parameters. trees: files that the server has already loaded."""
        words = self._machine(parameters, trees)
        return await self._answer('behavior_tool', ['check', '--json', *words, self._behavior(behavior)])

    async def prove_behavior(
        self,
        behavior: Behavior,
        require: Requirements = (),
        parameters: dict[Word, Word] = NONE,
        trees: tuple[File, ...] = (),
        faults: Faults = 1,
    ) -> Answer:
        """Explore everything that can happen to a state machine and its trees, as prove_tree does for a tree: any
        outcome, any answer of the operator, stops, dead servers."""
        words = [f'--faults={faults}', *_options('--require', require), *self._machine(parameters, trees)]
        return await self._prove('behavior_tool', words, [self._behavior(behavior)])

    async def draw_behavior(self, behavior: Behavior) -> str:
        """Draw a state machine as Mermaid text."""
        return await self._text(
            'behavior_tool', ['draw', '--format', 'mermaid', '--no-trees', self._behavior(behavior)]
        )

    async def synthesize_machine(
        self,
        capabilities: File,
        goals: Annotated[tuple[Word, ...], Field(max_length=20, description='Formulas; all are reached.')],
        initial: Annotated[tuple[Word, ...], Field(max_length=20, description='What holds at the start.')] = (),
        retries: Annotated[int, Field(ge=-1, le=1000, description='Attempts after a failure; -1: no limit.')] = -1,
        output: Annotated[str, Field(max_length=500, description='File to write the machine to (.yaml).')] = '',
    ) -> Answer:
        """Make a state machine that reaches the goals whatever fails, from a capability file (YAML: what each state
        needs, brings about, and how it fails). Without a solution (verdict "negative"): the smallest set of demands
        that conflict, and what may help."""
        words = ['synthesize', '--json', f'--time-limit={self._inner()}', *_options('--goal', goals)]
        words += [*_options('--initial', initial), *([f'--retries={retries}'] if retries >= 0 else [])]
        words += [f'--output={self._own(output)}'] if output else []
        return await self._answer('behavior_tool', [*words, *self._files([capabilities])])

    # Arguments of the commands.

    def _own(self, file: str) -> Path:
        """Return the path of a file that this server itself reads or writes. Raises RefusedCall."""
        try:
            path = (self.folder / file).resolve()
            parts = path.relative_to(self.folder).parts
        except (OSError, ValueError) as error:  # also a name with NUL
            raise RefusedCall(f'{truncate_middle(file)!r} is not in the folder of this server') from error
        if path.suffix not in _SUFFIXES or any(part.startswith('.') for part in parts):
            raise RefusedCall(f'{truncate_middle(file)!r} is not a visible file that ends with {", ".join(_SUFFIXES)}')
        return path

    def _files(self, files: Sequence[str]) -> list[str]:
        return [one if one.startswith('package://') else str(self._own(one).relative_to(self.folder)) for one in files]

    def _options(self, flag: str, files: Sequence[str]) -> list[str]:
        return _options(flag, self._files(files))

    def _behavior(self, behavior: str) -> str:
        if behavior.endswith(_SUFFIXES):
            return self._files([behavior])[0]
        if behavior.startswith('-') or re.search(r'\.py(:\w*)?$', behavior):  # no code of the folder is run
            raise RefusedCall(f'{truncate_middle(behavior)!r} is not the name of a behavior')
        return behavior

    def _machine(self, parameters: Mapping[str, str], trees: Sequence[str]) -> list[str]:
        values = _options('--param', (f'{name}={value}' for name, value in parameters.items()))
        return [*values, *self._options('--trees', trees)]

    def _inner(self) -> int:
        """Return the time limit of a search, s: it ends by itself, with what it has found, before it is killed."""
        return max(1, self.seconds // 2)

    # Running the commands.

    async def _prove(self, tool: str, words: Sequence[str], what: Sequence[str]) -> Answer:
        answer = await self._found(
            tool, ['prove', '--json', '--anew', '--quiet', f'--seconds={self._inner()}', *words, *what]
        )
        shown = ('name', 'bounds', 'complete', 'stopped_by', 'configurations', 'wrong', 'notes', 'ends', 'never')
        answer['proofs'] = [{key: one[key] for key in shown} for one in answer.get('proofs', ())]
        for one in answer['proofs']:
            one['wrong'] = [{key: wrong[key] for key in ('property', 'text', 'way')} for wrong in one['wrong']]
        return _fitting(answer)

    async def _answer(self, tool: str, words: Sequence[str]) -> Answer:
        return _fitting(await self._found(tool, words))

    async def _found(self, tool: str, words: Sequence[str]) -> Answer:
        code, out, err = await self._run(tool, words)
        try:
            found = json.loads(out)
        except ValueError:
            raise RefusedCall(_text(err) or f'{tool} {words[0]} ended with {code} and printed no answer') from None
        return {'verdict': _verdict(code), **found, 'notes': _text(err)}

    async def _text(self, tool: str, words: Sequence[str]) -> str:
        code, out, err = await self._run(tool, words)
        if code:
            raise RefusedCall(_text(err))
        return out if len(out) <= MAX_ANSWER else f'{out[:MAX_ANSWER]}\n%% shortened: draw one tree'

    async def _run(self, tool: str, words: Sequence[str]) -> tuple[int, str, str]:
        """Run a command; return its exit code and what it printed. Raises RefusedCall at the time limit."""
        for word in words:
            if _NO_TEXT.search(word):
                raise RefusedCall(f'{truncate_middle(word)!r} has a character that no text may have')
        if sum(map(len, words)) > _MAX_WORD:
            raise RefusedCall(f'the values are longer than {_MAX_WORD} characters; write them shorter')
        confined = ['-P', '-B', '-m', 'flexbt_tools.cli.confined', str(os.getpid()), str(self.seconds)]
        async with self.running:
            # Into files, so that the limit of the size of files bounds the output, too.
            with TemporaryFile() as out, TemporaryFile() as err, anyio.move_on_after(self.seconds):
                process = await anyio.run_process(
                    [sys.executable, *confined, tool, *words],
                    stdin=subprocess.DEVNULL, stdout=out, stderr=err,
                    check=False, cwd=self.folder, start_new_session=True,
                )  # fmt: skip
                if os.fstat(out.fileno()).st_size >= MAX_FILE:
                    raise RefusedCall(f'the answer is longer than {MAX_FILE} bytes; ask for less at once')
                if process.returncode < 0:
                    name = signal.Signals(-process.returncode).name
                    raise RefusedCall(
                        f'{tool} {words[0]} was ended by {name}: its limit of time, memory or output; give it less'
                    )
                return process.returncode, _read(out), _read(err)
        raise RefusedCall(
            f'{tool} {words[0]} was ended after {self.seconds} s without an answer; give it a smaller part'
        )


def _read(file: BinaryIO) -> str:
    file.seek(0)
    return file.read().decode('utf-8', 'replace')


def _options(flag: str, values: Any) -> list[str]:
    return [f'{flag}={value}' for value in values]


def _verdict(code: int) -> str:
    return ExitCode(code).name.lower()


def _text(err: str) -> str:
    """Return the last lines of what a command printed for people."""
    return '\n'.join(line for text in err.splitlines()[-30:] for line in escape_lines(text, limit=1000))


def _fitting(answer: Answer) -> Answer:
    """Return the answer, or if it is too long the parts of it that are short."""
    if len(json.dumps(answer)) <= MAX_ANSWER:
        return answer
    short = {key: value for key, value in answer.items() if len(json.dumps(value)) <= MAX_ANSWER // 10}
    findings = answer.get('findings', [])[:20]
    return {**short, 'findings': findings, 'left_out': [key for key in answer if key not in short]}


def _node_type(element: ElementTree.Element, *, with_ports: bool) -> Answer:
    description = element.find('MetadataFields/Metadata')
    shown: Answer = {
        'name': element.get('ID', ''),
        'kind': element.tag,
        'description': '' if description is None else description.get('description', ''),
    }
    if with_ports:
        shown['ports'] = [
            {'direction': port.tag.removesuffix('_port'), **port.attrib, 'meaning': port.text or ''}
            for port in element
            if port.tag.endswith('_port')
        ]
    return shown


def serve(folder: Path, seconds: int) -> None:
    """Serve on the standard streams until the client closes them."""
    tools = MissionTools(folder.resolve(), seconds, anyio.CapacityLimiter(_AT_ONCE))
    server = StrictServer(
        'flexbt',
        title='FlexBT missions',
        instructions=INSTRUCTIONS,
        version=version('flexbt_tools'),
        log_level='WARNING',
    )
    for name in vars(MissionTools):
        if name.startswith('_'):
            continue
        tool, is_reading = getattr(tools, name), name not in _WRITING
        hints = ToolAnnotations(read_only_hint=is_reading, destructive_hint=not is_reading, open_world_hint=False)
        server.add_tool(tool, description=' '.join((tool.__doc__ or '').split()), annotations=hints)
    server.run()

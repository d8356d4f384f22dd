# SPDX-License-Identifier: BSD-3-Clause
"""``flexbt-ls`` over standard input and output, as an editor starts it."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException
from pygls.lsp.client import LanguageClient

from flexbt_studio import language_server
from flexbt_studio.documents.project import Project
from flexbt_studio.documents.text import Lines, Span, TextEdit, applied
from flexbt_studio.language_server import FlexbtLanguageServer
from flexbt_testing.waiting import DEADLINE

PROGRAM = [
    sys.executable,
    '-c',
    'from flexbt_studio.executables import language_server; raise SystemExit(language_server())',
]
COMMAND = [*PROGRAM, '--stdio', '--clientProcessId=1']  # the options that editors add

TREE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <Wait wait_durations="1"/>
      <SubTree ID="Drive" goal="{goal}"/>
      <Script code="goal := 'goal'; x := goal"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
DRIVE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Drive">
    <AlwaysSuccess name="drive ä😀"/>
  </BehaviorTree>
</root>
"""


class Editor:
    """An editor with the files of a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.client = LanguageClient('test', '1')
        self.diagnostics: dict[str, list[lsp.Diagnostic]] = {}
        self.heard = asyncio.Event()

        @self.client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def heard(told: lsp.PublishDiagnosticsParams) -> None:
            self.diagnostics[told.uri] = list(told.diagnostics)
            self.heard.set()

        @self.client.feature(lsp.WINDOW_LOG_MESSAGE)
        def log(told: lsp.LogMessageParams) -> None:
            pass

    def uri(self, name: str) -> str:
        return (self.folder / name).as_uri()

    async def start(self, options: object = None, units: list[str] | None = None, **environment: str) -> None:
        await self.client.start_io(*COMMAND, env={**os.environ, **environment})
        root = self.folder.as_uri()
        begun = await self.client.initialize_async(
            lsp.InitializeParams(
                lsp.ClientCapabilities(general=lsp.GeneralClientCapabilities(position_encodings=units)),
                initialization_options=options,
                workspace_folders=[lsp.WorkspaceFolder(root, self.folder.name)],
            )
        )
        assert begun.capabilities.position_encoding == lsp.PositionEncodingKind.Utf16  # as the places are counted
        synchronized = begun.capabilities.text_document_sync
        assert isinstance(synchronized, lsp.TextDocumentSyncOptions)
        assert synchronized.change is lsp.TextDocumentSyncKind.Full  # pygls counts other lines, as behind U+2028
        self.client.initialized(lsp.InitializedParams())

    async def end(self) -> None:
        await self.client.shutdown_async(None)
        self.client.exit(None)
        await self.client.stop()  # type: ignore[no-untyped-call]  # of pygls

    async def show(self, name: str, text: str, version: int = 1) -> list[lsp.Diagnostic]:
        """Open a text, or change it to this one, and return its diagnostics."""
        self.heard.clear()
        uri = self.uri(name)
        if version == 1:
            self.client.text_document_did_open(lsp.DidOpenTextDocumentParams(lsp.TextDocumentItem(uri, 'xml', 1, text)))
        else:
            change = lsp.TextDocumentContentChangeWholeDocument(text)
            self.client.text_document_did_change(
                lsp.DidChangeTextDocumentParams(lsp.VersionedTextDocumentIdentifier(version, uri), [change])
            )
        await self.heard.wait()
        return self.diagnostics[uri]

    def at(self, name: str, text: str, word: str, shift: int = 1) -> tuple[lsp.TextDocumentIdentifier, lsp.Position]:
        """Return the place ``shift`` characters behind the beginning of a word."""
        position = lsp.Position(*Lines(text).position(text.index(word) + shift))
        return lsp.TextDocumentIdentifier(self.uri(name)), position


def with_editor(
    folder: Path,
    story: Callable[[Editor], Awaitable[None]],
    options: object = None,
    units: list[str] | None = None,
    **environment: str,
) -> None:
    async def run() -> None:
        editor = Editor(folder)
        async with asyncio.timeout(DEADLINE):
            await editor.start(options, units, **environment)
            await story(editor)
            await editor.end()

    asyncio.run(run())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / 'main.xml').write_text(TREE, encoding='utf-8')
    (tmp_path / 'drive.xml').write_text(DRIVE, encoding='utf-8')
    return tmp_path


def edited(text: str, edits: list[lsp.TextEdit]) -> str:
    lines = Lines(text)

    def offset(position: lsp.Position) -> int:
        return lines.offset(position.line, position.character)

    return applied(text, [TextEdit(offset(one.range.start), offset(one.range.end), one.new_text) for one in edits])


def test_a_wrong_port_is_told_and_mended(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        (found,) = await editor.show('main.xml', TREE)
        assert 'wait_duration' in found.message
        assert found.severity is lsp.DiagnosticSeverity.Error
        assert found.range.start.line == 3
        asked = lsp.CodeActionParams(
            lsp.TextDocumentIdentifier(editor.uri('main.xml')), found.range, lsp.CodeActionContext([found])
        )
        (action,) = await editor.client.text_document_code_action_async(asked) or []
        assert isinstance(action, lsp.CodeAction) and action.edit is not None and action.edit.changes is not None
        mended = edited(TREE, list(action.edit.changes[editor.uri('main.xml')]))
        assert mended == TREE.replace('wait_durations', 'wait_duration')
        assert [one for one in await editor.show('main.xml', mended, 2) if one.severity == 1] == []

    with_editor(folder, story)


def test_what_is_known_about_a_place(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        text = TREE.replace('wait_durations', 'wait_duration')
        await editor.show('main.xml', text)
        hover = await editor.client.text_document_hover_async(lsp.HoverParams(*editor.at('main.xml', text, '<Wait', 2)))
        assert hover is not None and isinstance(hover.contents, lsp.MarkupContent)
        assert 'wait_duration' in hover.contents.value
        where = await editor.client.text_document_definition_async(
            lsp.DefinitionParams(*editor.at('main.xml', text, 'Drive"'))
        )
        assert isinstance(where, lsp.Location) and where.uri == editor.uri('drive.xml')
        assert where.range.start == lsp.Position(1, DRIVE.splitlines()[1].index('Drive'))
        keys = await editor.client.text_document_completion_async(
            lsp.CompletionParams(*editor.at('main.xml', text, '{goal}'))
        )
        assert isinstance(keys, lsp.CompletionList) and '{goal}' in [one.label for one in keys.items]
        types = await editor.client.text_document_completion_async(
            lsp.CompletionParams(*editor.at('main.xml', text, '<Wait'))
        )
        assert isinstance(types, lsp.CompletionList)
        assert {'Wait', 'Sequence', 'SubTree'} <= {one.label for one in types.items}
        ports = await editor.client.text_document_completion_async(
            lsp.CompletionParams(*editor.at('main.xml', text, 'wait_duration', 0))
        )
        assert isinstance(ports, lsp.CompletionList) and 'server_timeout' in [one.label for one in ports.items]
        for shift, label, after in (
            (0, 'server_timeout', 'server_timeout="" wait_duration="1"'),
            (4, 'server_timeout', 'server_timeout="1"'),
            (13, 'wait_duration', 'wait_duration="1"'),
        ):  # the tag can be read afterwards
            at = editor.at('main.xml', text, 'wait_duration', shift)
            ports = await editor.client.text_document_completion_async(lsp.CompletionParams(*at))
            assert isinstance(ports, lsp.CompletionList)
            (edit,) = [one.text_edit for one in ports.items if one.label == label]
            assert isinstance(edit, lsp.TextEdit)
            assert edited(text, [edit]) == text.replace('wait_duration="1"', after)
        text = text.replace('<Sequence>', '<Sequence _skipIf="a > 1 || b < 2">').replace('="1"/>', '="1" />')
        await editor.show('main.xml', text, 2)  # what is in a value is no tag
        for place in (editor.at('main.xml', text, 'wait_duration', 0), editor.at('main.xml', text, '/>', 0)):
            ports = await editor.client.text_document_completion_async(lsp.CompletionParams(*place))
            assert isinstance(ports, lsp.CompletionList) and 'server_timeout' in [one.label for one in ports.items]
        text = TREE.replace('<Wait wait_durations="1"/>', '<Wait\n wait_duration = "1"\n/>')
        await editor.show('main.xml', text, 3)
        for word, shift, expected in (
            ('"1"', 3, []),  # an attribute would touch the value
            ('= "1"', 0, []),
            ('"1"', 0, []),
            ('\n/>', 1, 'server_timeout'),
            ("'goal'; x", 15, 'goal'),  # a name of the script, which stays
        ):
            at = editor.at('main.xml', text, word, shift)
            found = await editor.client.text_document_completion_async(lsp.CompletionParams(*at))
            assert isinstance(found, lsp.CompletionList)
            if not expected:
                assert not found.items, word
                continue
            (edit,) = [one.text_edit for one in found.items if one.label == expected]
            assert isinstance(edit, lsp.TextEdit)
            assert edit.range.start.line == edit.range.end.line == at[1].line
            assert edited(text, [edit]) in (text.replace('"1"\n', '"1"\nserver_timeout=""'), text), word

    with_editor(folder, story)


def test_a_tree_is_renamed_in_all_files_and_a_key_in_values_and_scripts(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        await editor.show('main.xml', TREE)
        renamed = await editor.client.text_document_rename_async(
            lsp.RenameParams(*editor.at('main.xml', TREE, 'Drive"'), 'DriveFar')
        )
        assert renamed is not None and renamed.changes is not None
        changes = {uri: list(edits) for uri, edits in renamed.changes.items()}
        assert edited(TREE, changes[editor.uri('main.xml')]) == TREE.replace('"Drive"', '"DriveFar"')
        assert edited(DRIVE, changes[editor.uri('drive.xml')]) == DRIVE.replace('"Drive"', '"DriveFar"')
        renamed = await editor.client.text_document_rename_async(
            lsp.RenameParams(*editor.at('main.xml', TREE, '{goal}', 2), 'pose')
        )
        assert renamed is not None and renamed.changes is not None
        text = edited(TREE, list(renamed.changes[editor.uri('main.xml')]))
        assert text == TREE.replace('{goal}', '{pose}').replace(
            "goal := 'goal'; x := goal", "pose := 'goal'; x := pose"
        )
        with pytest.raises(JsonRpcException, match='already'):
            await editor.client.text_document_rename_async(
                lsp.RenameParams(*editor.at('main.xml', TREE, 'Drive"'), 'Main')
            )

    with_editor(folder, story)


MACHINE = """\
machine:
  outcomes: [finished]
  states:
    Wait:
      state: WaitState
      parameters:
        wait_time: 1.0
      transitions: {done: Again}
    Again:
      state: WaitState
      parameters: {wait_time: 2.0}
      transitions:
        done: finishd
"""


def test_a_machine_is_checked_and_helped(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        (found,) = await editor.show('round.yaml', MACHINE)
        assert 'finished' in found.message and found.range.start.line == 12
        asked = lsp.CodeActionParams(
            lsp.TextDocumentIdentifier(editor.uri('round.yaml')), found.range, lsp.CodeActionContext([found])
        )
        (action,) = await editor.client.text_document_code_action_async(asked) or []
        assert isinstance(action, lsp.CodeAction) and action.edit is not None and action.edit.changes is not None
        mended = edited(MACHINE, list(action.edit.changes[editor.uri('round.yaml')]))
        assert mended == MACHINE.replace('finishd', 'finished')
        for word, shift, expected in (
            ('WaitState', 0, 'WaitState'),
            ('Again}', 1, 'finished'),
            ('finishd', 2, 'Wait'),
            ('wait_time: 1', 0, 'wait_time'),
        ):
            text = MACHINE.replace('wait_time: 1.0', '') if word.startswith('wait_time') else MACHINE
            position = editor.at('round.yaml', MACHINE, word, shift)
            if text != MACHINE:
                await editor.show('round.yaml', text, 2)
            got = await editor.client.text_document_completion_async(lsp.CompletionParams(*position))
            assert isinstance(got, lsp.CompletionList), word
            assert expected in [one.label for one in got.items], word
        await editor.show('round.yaml', MACHINE, 3)
        hover = await editor.client.text_document_hover_async(
            lsp.HoverParams(*editor.at('round.yaml', MACHINE, 'WaitState', 3))
        )
        assert hover is not None and isinstance(hover.contents, lsp.MarkupContent)
        assert 'wait_time' in hover.contents.value

    with_editor(folder, story)


def test_names_of_a_machine_are_found_and_renamed_in_all_files(folder: Path) -> None:
    (folder / 'site.yaml').write_text('round:\n  - /Again only after /Wait > done\n')
    machine = MACHINE.replace('finishd', 'finished')
    (folder / 'round.yaml').write_text(machine)

    async def story(editor: Editor) -> None:
        await editor.show('round.yaml', machine)
        at = editor.at('round.yaml', machine, 'Again}')
        found = await editor.client.text_document_references_async(
            lsp.ReferenceParams(lsp.ReferenceContext(include_declaration=True), *at)
        )
        assert found is not None
        assert [(one.uri, one.range.start.line) for one in found] == [
            (editor.uri('round.yaml'), 7),
            (editor.uri('round.yaml'), 8),
            (editor.uri('site.yaml'), 1),
        ]
        others = await editor.client.text_document_references_async(
            lsp.ReferenceParams(lsp.ReferenceContext(include_declaration=False), *at)
        )
        assert [*(others or ())] == [found[0], found[2]]
        prepared = await editor.client.text_document_prepare_rename_async(lsp.PrepareRenameParams(*at))
        assert isinstance(prepared, lsp.PrepareRenamePlaceholder)
        assert (prepared.range, prepared.placeholder) == (found[0].range, 'Again')  # of a name with blanks, all of it
        renamed = await editor.client.text_document_rename_async(lsp.RenameParams(*at, 'Wait more'))
        assert renamed is not None and renamed.changes is not None
        texts = {'round.yaml': machine, 'site.yaml': (folder / 'site.yaml').read_text()}
        for name, text in texts.items():
            after = edited(text, list(renamed.changes[editor.uri(name)]))
            assert after == text.replace('Again', 'Wait more')
        with pytest.raises(JsonRpcException, match='its code'):
            await editor.client.text_document_prepare_rename_async(
                lsp.PrepareRenameParams(*editor.at('round.yaml', machine, 'done: Again'))
            )

    with_editor(folder, story)


def test_a_text_with_an_error_is_told_and_still_helped(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        broken = TREE.replace('</Sequence>', '<')
        found = await editor.show('main.xml', broken)
        assert any(one.severity is lsp.DiagnosticSeverity.Error for one in found)
        keys = await editor.client.text_document_completion_async(
            lsp.CompletionParams(*editor.at('main.xml', broken, '{goal}'))
        )
        assert isinstance(keys, lsp.CompletionList) and keys.items
        assert [one for one in await editor.show('main.xml', TREE, 2) if 'wait_duration' in one.message]

    with_editor(folder, story)


def test_places_are_counted_in_the_units_that_are_announced(folder: Path) -> None:
    text = DRIVE.replace('😀"', '😀" _skipIf="far"')

    async def story(editor: Editor) -> None:
        (found,) = [one for one in await editor.show('drive.xml', text) if '[far]' in one.message]
        line = text.splitlines()[2]
        assert found.range.start.character == line.index('_skipIf') + 1  # one character needs two units

    with_editor(folder, story, units=['utf-8', 'utf-16'])


def test_what_the_editor_shows_is_known_after_a_visit_elsewhere(folder: Path) -> None:
    home, other = folder / 'home', folder / 'other'
    for one in (home, other):
        one.mkdir()
    text = TREE.replace('<Sequence>', '<Sequence>\n')
    (home / 'main.xml').write_text(TREE)

    async def story(editor: Editor) -> None:
        await editor.show('main.xml', text)
        at = editor.at('main.xml', text, '{goal}', 2)
        editor.folder = other
        await editor.show('drive.xml', DRIVE)
        renamed = await editor.client.text_document_rename_async(lsp.RenameParams(*at, 'pose'))
        assert renamed is not None and renamed.changes is not None
        (changes,) = renamed.changes.values()
        assert '{pose}' in edited(text, list(changes)) and '{goal}' not in edited(text, list(changes))

    with_editor(home, story)


def test_a_folder_that_the_editor_adds_is_the_project_of_its_files(folder: Path) -> None:
    (folder / 'mine#1').mkdir()
    (folder / 'drive.xml').rename(folder / 'mine#1' / 'drive.xml')
    empty = folder / 'empty'
    empty.mkdir()

    async def story(editor: Editor) -> None:
        added = lsp.WorkspaceFolder(folder.as_uri(), 'added')
        editor.client.workspace_did_change_workspace_folders(
            lsp.DidChangeWorkspaceFoldersParams(lsp.WorkspaceFoldersChangeEvent([added], []))
        )
        editor.folder = folder
        text = TREE.replace('wait_durations', 'wait_duration')
        assert not [one.message for one in await editor.show('main.xml', text) if 'no tree' in one.message]
        shown = DRIVE.replace('ID="Drive"', 'ID="Shown"')
        await editor.show('mine#1/drive.xml', shown)
        editor.folder = empty
        await editor.show('other.xml', DRIVE.replace('ID="Drive"', 'ID="Other"'))
        editor.folder = folder
        assert [one.message for one in await editor.show('main.xml', text, 2) if 'no tree [Drive]' in one.message]

    with_editor(empty, story)


def test_a_text_that_only_the_editor_can_decode_is_checked_as_it_is_shown(folder: Path) -> None:
    text = TREE.replace('<Sequence>', '<Sequence name="é">')
    (folder / 'main.xml').write_bytes(text.encode('latin-1'))

    async def story(editor: Editor) -> None:
        (found,) = await editor.show('main.xml', text)
        assert 'wait_duration' in found.message

    with_editor(folder, story)


def test_files_of_other_programs_have_no_findings(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        assert await editor.show('compose.yaml', 'services: {web: {image: x}}\n') == []
        package = '<package format="3"/>\n'
        assert await editor.show('package.xml', package) == []
        at = editor.at('package.xml', package, '<', 1)
        found = await editor.client.text_document_completion_async(lsp.CompletionParams(*at))
        assert isinstance(found, lsp.CompletionList) and not found.items
        assert await editor.show('setup.py', 'setup()\n') == []
        assert await editor.show('notes.txt', 'machine:\n') == []
        assert await editor.show('setup.py', 'class A(Behavior):\n    pass\n', 2)

    with_editor(folder, story)


def test_what_is_found_in_other_files_is_told_when_their_trees_appear(folder: Path) -> None:
    (folder / 'drive.xml').unlink()

    async def story(editor: Editor) -> None:
        text = TREE.replace('wait_durations', 'wait_duration')
        assert [one for one in await editor.show('main.xml', text) if 'no tree [Drive]' in one.message]
        await editor.show('drive.xml', DRIVE)
        await until_missing(editor, False)
        closed = lsp.TextDocumentIdentifier(editor.uri('drive.xml'))  # it was not saved
        editor.client.text_document_did_close(lsp.DidCloseTextDocumentParams(closed))
        await until_missing(editor, True)

    async def until_missing(editor: Editor, is_missing: bool) -> None:
        main = editor.uri('main.xml')
        while any('no tree [Drive]' in one.message for one in editor.diagnostics[main]) is not is_missing:
            editor.heard.clear()
            await editor.heard.wait()

    with_editor(folder, story)


@pytest.mark.parametrize('is_asked', [True, False])
def test_the_exit_code_tells_whether_the_editor_has_asked_to_end(is_asked: bool) -> None:
    initialize: dict[str, Any] = {'id': 1, 'method': 'initialize', 'params': {'capabilities': {}}}
    told: list[dict[str, Any]] = [
        initialize,
        *([{'id': 2, 'method': 'shutdown'}] if is_asked else []),
        {'method': 'exit'},
    ]
    texts = (json.dumps({'jsonrpc': '2.0', **one}) for one in told)
    written = ''.join(f'Content-Length: {len(text)}\r\n\r\n{text}' for text in texts)
    done = subprocess.run(COMMAND, input=written.encode(), capture_output=True, timeout=DEADLINE)
    assert done.returncode == (0 if is_asked else 1), done.stderr


def test_what_code_of_the_user_prints_is_no_message(folder: Path) -> None:
    (folder / 'loud.py').write_text('print("imported")\n')
    description = folder / 'loud-0.dist-info'
    description.mkdir()
    (description / 'METADATA').write_text('Metadata-Version: 2.1\nName: loud\nVersion: 0\n')
    (description / 'entry_points.txt').write_text('[flexbt.states]\nloud = loud\n')

    async def story(editor: Editor) -> None:
        assert await editor.show('main.xml', TREE)

    with_editor(folder, story, PYTHONPATH=f'{folder}:{os.environ.get("PYTHONPATH", "")}')


def test_a_state_that_hangs_when_it_is_made_is_told_and_the_editor_is_answered(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hanging = 'import time\nfrom flexbt_core import EventState\n\n\nclass Hanging(EventState):\n'
    (folder / 'hanging.py').write_text(f'{hanging}    def __init__(self):\n        time.sleep(1000)\n')
    description = folder / 'hanging-0.dist-info'
    description.mkdir()
    (description / 'METADATA').write_text('Metadata-Version: 2.1\nName: hanging\nVersion: 0\n')
    (description / 'entry_points.txt').write_text('[flexbt.states]\nhanging = hanging\n')
    command = 'import flexbt_studio.machine_checks as checks; checks.MACHINE_SECONDS = 2.0; ' + COMMAND[-1]
    monkeypatch.setattr(sys.modules[__name__], 'COMMAND', [*COMMAND[:-1], command])
    machine = 'machine:\n  outcomes: [done]\n  states:\n    A: {state: Hanging, transitions: {done: done}}\n'

    async def story(editor: Editor) -> None:
        shown = asyncio.create_task(editor.show('round.yaml', machine))
        await asyncio.sleep(0)
        found = await editor.client.text_document_completion_async(
            lsp.CompletionParams(*editor.at('round.yaml', machine, 'Hanging'))
        )
        assert isinstance(found, lsp.CompletionList)
        assert ['hangs' in one.message for one in await shown] == [True]
        assert await editor.show('main.xml', TREE)

    with_editor(folder, story, PYTHONPATH=f'{folder}:{os.environ.get("PYTHONPATH", "")}')


def test_a_file_that_is_shown_by_a_link_is_edited_there(tmp_path: Path, folder: Path) -> None:
    (tmp_path / 'link').symlink_to(folder)

    async def story(editor: Editor) -> None:
        await editor.show('main.xml', TREE)
        place = editor.at('main.xml', TREE, '{goal}', 2)
        renamed = await editor.client.text_document_rename_async(lsp.RenameParams(*place, 'pose'))
        assert renamed is not None and renamed.changes is not None
        assert list(renamed.changes) == [editor.uri('main.xml')]

    with_editor(tmp_path / 'link', story)


def test_an_older_text_that_the_editor_shows_beside_a_file_is_not_its_text(folder: Path) -> None:
    async def story(editor: Editor) -> None:
        unsaved = f'\n{TREE}'
        await editor.show('main.xml', unsaved)
        place = editor.at('main.xml', unsaved, '{goal}', 2)
        older = lsp.TextDocumentItem(editor.uri('main.xml').replace('file:', 'git:'), 'xml', 1, TREE)
        closed = lsp.DidCloseTextDocumentParams(lsp.TextDocumentIdentifier(older.uri))
        for is_open in (True, False):
            if is_open:
                editor.client.text_document_did_open(lsp.DidOpenTextDocumentParams(older))
            else:
                editor.client.text_document_did_close(closed)
            renamed = await editor.client.text_document_rename_async(lsp.RenameParams(*place, 'pose'))
            assert renamed is not None and renamed.changes is not None
            assert '{pose}' in edited(unsaved, list(renamed.changes[editor.uri('main.xml')]))

    with_editor(folder, story)


def test_many_places_in_a_text_read_its_lines_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server = FlexbtLanguageServer.__new__(FlexbtLanguageServer)
    server.project = Project(folder)
    (folder / 'main.xml').write_text(f'{TREE}<!-- read once -->')
    read: list[str] = []

    def lines(text: str) -> Lines:
        read.append(text)
        return Lines(text)

    monkeypatch.setattr(language_server, 'Lines', lines)
    places = [server.range('main.xml', Span(start, start + 1)) for start in range(20)]
    assert len(read) == 1 and places[-1].end.character == 20


def test_help_and_version_are_told_to_a_person() -> None:
    for option, told in (('--help', 'usage: flexbt-ls'), ('--version', '0.1.0')):
        done = subprocess.run([*PROGRAM, option], capture_output=True, text=True, timeout=DEADLINE)
        assert (done.returncode, done.stdout.startswith(told)) == (0, True), done

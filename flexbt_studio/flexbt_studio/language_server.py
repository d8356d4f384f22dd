# SPDX-License-Identifier: BSD-3-Clause
"""``flexbt-ls``: a language server for trees, machines and behaviors, over standard input and output.

Diagnostics, completion, hover, definition, references, rename and quick fixes in any editor that speaks the language
server protocol. It stands on the same documents as the page of the studio.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import functools
import inspect
import os
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcException
from pygls.lsp.server import LanguageServer
from pygls.protocol import LanguageServerProtocol, lsp_method
from pygls.uris import from_fs_path

from flexbt_core.behavior_tree.engine.registry import node_skills
from flexbt_core.values.findings import finding_record
from flexbt_onboard.behaviors.machine_behavior import installed_states
from flexbt_server.node_types import node_registry
from flexbt_studio.documents.diagnostics import Checker, Finding
from flexbt_studio.documents.editor_help import Completion, MachineHelp, TreeHelp
from flexbt_studio.documents.names import Named, Names
from flexbt_studio.documents.palette import states
from flexbt_studio.documents.project import Place, Project, kind_of
from flexbt_studio.documents.text import Lines, Span, TextEdit
from flexbt_studio.errors import StudioError
from flexbt_studio.machine_checks import MachineChecks
from flexbt_studio.tool_process import check_copy, checked

NAME: Final = 'flexbt-ls'
VERSION: Final = '0.1.0'
RUN_PYTHON: Final = 'flexbt.runPython'
"""Command that allows to run the code of behaviors in Python, as the initialization option ``runPython`` does."""
PAUSE: Final = 0.3
"""Time without an edit after which a behavior in Python, and the files that may use an edited tree, are checked, s."""

_MARK: Final = '_feature'
_KINDS: Final = {
    'node': lsp.CompletionItemKind.Class,
    'tree': lsp.CompletionItemKind.Module,
    'port': lsp.CompletionItemKind.Property,
    'key': lsp.CompletionItemKind.Variable,
    'state': lsp.CompletionItemKind.Class,
    'value': lsp.CompletionItemKind.Value,
}
_SEVERITIES: Final = {
    'error': lsp.DiagnosticSeverity.Error,
    'warning': lsp.DiagnosticSeverity.Warning,
    'info': lsp.DiagnosticSeverity.Information,
}


def feature(name: str, options: Any = None) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator for a method that answers what the editor asks, or hears what it tells.

    A refusal reaches the editor as its message, not as a fault.
    """

    def marked(method: Callable[..., Any]) -> Callable[..., Any]:
        def answer(ls: FlexbtLanguageServer, asked: Any) -> Any:
            try:
                return method(ls, asked)
            except StudioError as error:
                raise JsonRpcException(str(error), lsp.LSPErrorCodes.RequestFailed) from error

        setattr(answer, _MARK, (name, options))
        return answer

    return marked


class _Utf16Protocol(LanguageServerProtocol):
    """The protocol with columns in UTF-16 code units, which all editors know, also those that prefer others."""

    @lsp_method(lsp.INITIALIZE)
    def lsp_initialize(self, params: lsp.InitializeParams) -> Generator[Any, Any, lsp.InitializeResult]:
        """Begin as the protocol does, without a choice of units: pygls would take those that the editor prefers."""
        if params.capabilities.general is not None:
            params.capabilities.general.position_encodings = None
        return (yield from super().lsp_initialize(params))


class FlexbtLanguageServer(LanguageServer):
    """The server of one editor, with the project of its first folder."""

    def __init__(self) -> None:
        # Whole texts: pygls counts the lines of a part of a text by more line breaks than editors do.
        super().__init__(NAME, VERSION, lsp.TextDocumentSyncKind.Full, protocol_cls=_Utf16Protocol)
        for _, method in inspect.getmembers(type(self), lambda one: hasattr(one, _MARK)):
            self.feature(*getattr(method, _MARK))(method)
        self.command(RUN_PYTHON)(functools.partial(self.run_code))
        notes: list[str] = []
        self._notes = notes
        self._registry = node_registry(lambda nodes, error: notes.append(f'without {nodes}: {error}'))
        self._skills = node_skills(self._registry, notes.append)
        classes, broken = installed_states()
        notes += broken
        self._palette = states(classes)
        self._runs_code = False
        self.is_ended = False
        """Whether the editor has asked to end."""
        self._machines = MachineChecks()
        self._checking = ThreadPoolExecutor(1, 'checking')
        self._checks: dict[str, asyncio.Task[None]] = {}
        """Checks that run, by the URIs of their files."""
        self._checking_users: asyncio.Task[None] | None = None
        self._found: dict[str, Sequence[Finding]] = {}
        """Findings for the texts that the editor shows, by URI, as far as they were checked."""
        self._uris: dict[Path, str] = {}
        """URIs by which the editor shows files: they may have links."""
        self._use(Path.cwd())

    def shutdown(self) -> None:
        self._checking.shutdown(wait=False, cancel_futures=True)
        self._machines.close()
        super().shutdown()  # type: ignore[no-untyped-call]  # of pygls

    def _use(self, root: Path) -> None:
        self.project = Project(root)
        self.checker = Checker(self.project, self._registry, self._skills)
        self.names = Names(self.project, self._registry, self.checker, self._palette)
        self.trees = TreeHelp(self.project, self._registry)
        self.machines = MachineHelp(self.project, self._palette)

    def file(self, uri: str) -> str:
        """Return the name of a file in the project.

        A file outside of it makes another folder the project: that of the editor with the file, else its own. What the
        editor shows of that folder is taken over.
        """
        path = _path(uri)
        folders = (_path(one.uri) for one in self.workspace.folders.values())
        kept = self.project.root if path.is_relative_to(self.project.root) else path.parent
        root = next((folder for folder in folders if path.is_relative_to(folder)), kept)
        if root != self.project.root:
            self._use(root)
            for shown in self.workspace.text_documents.values():
                if _is_file(shown.uri) and _path(shown.uri).is_relative_to(root):
                    self._take(_path(shown.uri).relative_to(root).as_posix(), shown.source)
        return path.relative_to(root).as_posix()

    def _take(self, file: str, text: str) -> None:
        """Take the text that the editor shows of a file."""
        with contextlib.suppress(StudioError):  # of a file that has nothing to do with FlexBT
            self.project.adopt(file, text)

    def uri(self, file: str) -> str:
        """Return the URI of a file of the project."""
        path = self.project.root / file
        uri = self._uris.get(path) or from_fs_path(str(path))
        assert uri is not None
        return uri

    def range(self, file: str, span: Span) -> lsp.Range:
        """Return a span as lines and columns."""
        return _range(self.project.text(file), span)

    def offset(self, file: str, position: lsp.Position) -> int:
        """Return the offset of a position."""
        return _lines(self.project.text(file)).offset(position.line, position.character)

    def named(self, asked: lsp.DefinitionParams | lsp.ReferenceParams | lsp.RenameParams) -> Named:
        """Return what the name means that an editor asks about. Raises StudioError if there is none."""
        file = self.file(asked.text_document.uri)
        return self.names.at(file, self.offset(file, asked.position))

    def helper(self, document: lsp.TextDocumentIdentifier) -> tuple[str, TreeHelp | MachineHelp | None]:
        """Return the name of a file and what helps in it; None if nothing does."""
        file = self.file(document.uri)
        helpers: dict[str, TreeHelp | MachineHelp] = {'xml': self.trees, 'yaml': self.machines}
        kind = kind_of(file, self.project.text(file))
        return file, None if kind is None else helpers.get(kind.document.language)

    def edits(self, file: str, edits: Sequence[TextEdit]) -> list[lsp.TextEdit]:
        """Return edits as the protocol has them."""
        return [lsp.TextEdit(self.range(file, Span(one.start, one.end)), one.text) for one in edits]

    def location(self, place: Place) -> lsp.Location:
        """Return a place as the protocol has it."""
        return lsp.Location(self.uri(place.file), self.range(place.file, place.span))

    def show(self, uri: str, text: str, version: int | None) -> None:
        """Take the text that the editor shows of a file, and publish its diagnostics if it is one of FlexBT."""
        if not _is_file(uri):
            return
        file = self.file(uri)
        self._uris[self.project.root / file] = uri
        self._take(file, text)
        self._forget(uri)
        kind = kind_of(file, text)
        if kind is None:
            self._publish(uri, text, [], version)
        elif kind.name == 'machine':
            self._checks[uri] = asyncio.ensure_future(self._check_machine(uri, file, text, version))
        elif self._runs_code and kind.name == 'behavior' and not self.project.open(file).document.problems:
            self._checks[uri] = asyncio.ensure_future(self._check_code(uri, file, text, version))
        else:
            self._publish(uri, text, self.checker.findings(file), version)
            if kind.name == 'trees':
                self._check_users_soon(file)

    def _check_users_soon(self, file: str) -> None:
        if self._checking_users is not None:
            self._checking_users.cancel()
        self._checking_users = asyncio.ensure_future(self._check_users(file))

    async def _check_users(self, file: str) -> None:
        """Publish the diagnostics of the files that may use the trees of a file, after a pause."""
        project = self.project
        await asyncio.sleep(PAUSE)
        for other in self.checker.users(file) if self.project is project else ():
            uri = self._uris.get(project.root / other)
            if uri is not None:
                shown = self.workspace.get_text_document(uri)
                self._publish(uri, shown.source, self.checker.findings(other), shown.version)

    def run_code(self) -> None:
        """Check the behaviors in Python that are open, and those that will be, by running their code."""
        self._runs_code = True
        for file, opened in self.project.open_files.items():
            if file.endswith('.py'):
                self.show(self.uri(file), opened.document.text, None)

    def _forget(self, uri: str) -> None:
        """Forget the findings of an older text, and end its check."""
        self._found.pop(uri, None)
        if uri in self._checks:
            self._checks.pop(uri).cancel()

    async def _check_machine(self, uri: str, file: str, text: str, version: int | None) -> None:
        check = functools.partial(self._machines.findings, self.project.root, file, text)
        try:
            found = await asyncio.get_running_loop().run_in_executor(self._checking, check)
        except StudioError as error:
            found = [Finding(finding_record('not-checked', 'warning', str(error)), Span(0, 0))]
        self._publish(uri, text, found, version)

    async def _check_code(self, uri: str, file: str, text: str, version: int | None) -> None:
        project, checker = self.project, self.checker
        await asyncio.sleep(PAUSE)
        try:
            name, copy = check_copy(project, file)
            self._publish(uri, text, checker.located(file, name, await checked(copy)), version)
        except StudioError as error:
            self.window_log_message(lsp.LogMessageParams(lsp.MessageType.Warning, str(error)))

    def _publish(self, uri: str, text: str, findings: Sequence[Finding], version: int | None) -> None:
        self._found[uri] = findings
        found = [_diagnostic(text, one) for one in findings]
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, found, version))

    # What editors ask and tell.

    @feature(lsp.INITIALIZE)
    def _begin(self, asked: lsp.InitializeParams) -> None:
        """Take the first folder of the editor as the project, and tell what could not be loaded."""
        if asked.root_uri and not self.workspace.folders:
            self.workspace.add_folder(lsp.WorkspaceFolder(asked.root_uri, NAME))
        for folder in [*self.workspace.folders.values()][:1]:
            self._use(_path(folder.uri))
        options = asked.initialization_options
        self._runs_code = isinstance(options, dict) and options.get('runPython') is True
        for note in self._notes:
            self.window_log_message(lsp.LogMessageParams(lsp.MessageType.Warning, note))

    @feature(lsp.SHUTDOWN)
    def _end(self, asked: None) -> None:
        self.is_ended = True

    @feature(lsp.TEXT_DOCUMENT_DID_OPEN)
    def _opened(self, told: lsp.DidOpenTextDocumentParams) -> None:
        self.show(told.text_document.uri, told.text_document.text, told.text_document.version)

    @feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
    def _changed(self, told: lsp.DidChangeTextDocumentParams) -> None:
        document = self.workspace.get_text_document(told.text_document.uri)
        self.show(told.text_document.uri, document.source, told.text_document.version)

    @feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
    def _closed(self, told: lsp.DidCloseTextDocumentParams) -> None:
        if not _is_file(told.text_document.uri):
            return
        file = self.file(told.text_document.uri)
        self._forget(told.text_document.uri)
        self._uris.pop(self.project.root / file, None)
        self.project.close(file)
        self._check_users_soon(file)  # what was not saved is gone
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(told.text_document.uri, []))

    @feature(lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=['<', '{', '"', ' ']))
    def _complete(self, asked: lsp.CompletionParams) -> lsp.CompletionList:
        file, helper = self.helper(asked.text_document)
        found = [] if helper is None else helper.completions(file, self.offset(file, asked.position))
        return lsp.CompletionList(is_incomplete=False, items=[self._item(file, one) for one in found])

    @feature(lsp.TEXT_DOCUMENT_HOVER)
    def _hover(self, asked: lsp.HoverParams) -> lsp.Hover | None:
        file, helper = self.helper(asked.text_document)
        found = None if helper is None else helper.help(file, self.offset(file, asked.position))
        if found is None:
            return None
        return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, found.text), self.range(file, found.span))

    @feature(lsp.TEXT_DOCUMENT_DEFINITION)
    def _definition(self, asked: lsp.DefinitionParams) -> lsp.Location | None:
        try:
            named = self.named(asked)  # which may choose the project
            return self.location(self.names.definition(named))
        except StudioError:
            return None

    @feature(lsp.TEXT_DOCUMENT_REFERENCES)
    def _references(self, asked: lsp.ReferenceParams) -> list[lsp.Location]:
        named = self.named(asked)
        places = [Place(one.file, one.span) for one in self.names.uses(named)]
        if not asked.context.include_declaration:
            with contextlib.suppress(StudioError):  # it is in code
                declared = self.names.definition(named)
                places = [one for one in places if one != declared]
        return [self.location(one) for one in places]

    @feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
    def _prepare(self, asked: lsp.PrepareRenameParams) -> lsp.PrepareRenamePlaceholder:
        file = self.file(asked.text_document.uri)
        use = self.names.use_at(file, self.offset(file, asked.position))
        return lsp.PrepareRenamePlaceholder(self.range(file, use.span), use.named.name)

    @feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
    def _rename(self, asked: lsp.RenameParams) -> lsp.WorkspaceEdit:
        named = self.named(asked)
        made = self.names.rename(named, asked.new_name)
        for one in made.notes:
            place = f'{one.file}:{self.range(one.file, one.span).start.line + 1}'
            self.window_log_message(lsp.LogMessageParams(lsp.MessageType.Info, f'not renamed: {place}: {one.text}'))
        return lsp.WorkspaceEdit({self.uri(one): self.edits(one, edits) for one, edits in made.edits.items()})

    @feature(lsp.TEXT_DOCUMENT_CODE_ACTION, lsp.CodeActionOptions([lsp.CodeActionKind.QuickFix]))
    def _fixes(self, asked: lsp.CodeActionParams) -> list[lsp.CodeAction]:
        file = self.file(asked.text_document.uri)
        start, end = self.offset(file, asked.range.start), self.offset(file, asked.range.end)
        return [
            lsp.CodeAction(
                fix.title,
                kind=lsp.CodeActionKind.QuickFix,
                edit=lsp.WorkspaceEdit({asked.text_document.uri: self.edits(file, fix.edits)}),
            )
            for one in self._found.get(asked.text_document.uri, ())
            if one.span.start <= end and start <= one.span.end
            for fix in one.fixes
        ]

    def _item(self, file: str, completion: Completion) -> lsp.CompletionItem:
        return lsp.CompletionItem(
            completion.label,
            kind=_KINDS.get(completion.kind),
            detail=completion.detail or None,
            documentation=lsp.MarkupContent(lsp.MarkupKind.Markdown, completion.documentation),
            text_edit=lsp.TextEdit(self.range(file, completion.span), completion.text),
        )


@functools.lru_cache(maxsize=8)
def _lines(text: str) -> Lines:
    """Return the lines of a text: an answer has many places in one."""
    return Lines(text)


def _range(text: str, span: Span) -> lsp.Range:
    lines = _lines(text)
    start, end = lines.position(span.start), lines.position(span.end)
    return lsp.Range(lsp.Position(*start), lsp.Position(*end))


def _diagnostic(text: str, finding: Finding) -> lsp.Diagnostic:
    record = finding.record
    message = record['message']
    if record['fix'] and record['fix'] not in message:
        message = f'{message}; {record["fix"]}'
    return lsp.Diagnostic(
        _range(text, finding.span),
        message,
        _SEVERITIES.get(record['severity'], lsp.DiagnosticSeverity.Information),
        code=record['rule'],
        source='flexbt',
    )


def _is_file(uri: str) -> bool:
    """Return whether a URI is that of a file, not of an older text of one or the like, as ``git:/the/file.xml``."""
    return urlsplit(uri).scheme in ('file', '')


def _path(uri: str) -> Path:
    return Path(unquote(urlsplit(uri).path)).resolve()


def main() -> int:
    """Serve the editor that started this process until it ends. Return 1 if the editor has not asked to end before."""
    parser = argparse.ArgumentParser(NAME, description='Language server for trees, machines and behaviors.')
    parser.add_argument('--version', action='version', version=VERSION)
    parser.add_argument('--stdio', action='store_true', help='use standard input and output, as without this option')
    parser.parse_known_args()  # editors add options of their own
    messages = os.fdopen(os.dup(1), 'wb')
    os.dup2(2, 1)  # what states and nodes print is no message
    server = FlexbtLanguageServer()
    server.start_io(stdout=messages)
    return 0 if server.is_ended else 1

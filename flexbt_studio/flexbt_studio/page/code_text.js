// SPDX-License-Identifier: BSD-3-Clause
// The text pane with CodeMirror. It is in a shadow root, where CodeMirror's styles need no exception from the page's policy.

import {autocompletion, closeBrackets, completionKeymap} from '@codemirror/autocomplete';
import {defaultKeymap, history, historyKeymap, isolateHistory, redo, undo, undoDepth} from '@codemirror/commands';
import {python} from '@codemirror/lang-python';
import {xml} from '@codemirror/lang-xml';
import {yaml} from '@codemirror/lang-yaml';
import {bracketMatching, foldGutter, foldKeymap, HighlightStyle, indentUnit, syntaxHighlighting} from '@codemirror/language';
import {lintGutter, setDiagnostics} from '@codemirror/lint';
import {MergeView} from '@codemirror/merge';
import {search, searchKeymap} from '@codemirror/search';
import {EditorSelection, EditorState, Transaction} from '@codemirror/state';
import {drawSelection, EditorView, highlightActiveLine, highlightActiveLineGutter, keymap, lineNumbers} from '@codemirror/view';
import {tags} from '@lezer/highlight';

import {fromEdits, toEdits} from './changes.js';

const LANGUAGES = {xml, yaml, python};
const COLORS = HighlightStyle.define([
  {tag: [tags.tagName, tags.keyword, tags.definitionKeyword], color: 'var(--accent)'},
  {tag: [tags.attributeName, tags.propertyName], color: 'var(--decision)'},
  {tag: [tags.attributeValue, tags.string], color: 'var(--good)'},
  {tag: [tags.number, tags.bool, tags.null], color: 'var(--warning)'},
  {tag: tags.comment, color: 'var(--dim)', fontStyle: 'italic'},
  {tag: tags.invalid, color: 'var(--error)'},
]);
const THEME = EditorView.theme({
  '&': {flex: '1', minWidth: '0', height: '100%', color: 'var(--text)', backgroundColor: 'var(--back)', fontSize: '13px'},
  '&.cm-focused': {outline: 'none'},
  '.cm-scroller': {fontFamily: 'var(--mono)', lineHeight: '1.5', scrollbarWidth: 'thin'},
  '.cm-content': {caretColor: 'var(--text)'},
  '.cm-cursor': {borderLeftColor: 'var(--text)', borderLeftWidth: '2px'},
  '.cm-gutters': {backgroundColor: 'var(--pane)', color: 'var(--dim)', borderRight: '1px solid var(--line)'},
  '.cm-activeLine, .cm-activeLineGutter': {backgroundColor: 'color-mix(in srgb, var(--soft) 55%, transparent)'},
  '&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground': {background: 'color-mix(in srgb, var(--accent) 28%, transparent)'},
  '.cm-tooltip, .cm-panels': {backgroundColor: 'var(--pane)', color: 'var(--text)', border: '1px solid var(--edge)'},
  '.cm-tooltip-autocomplete > ul > li[aria-selected]': {backgroundColor: 'var(--accent)', color: 'var(--on-accent)'},
  '.cm-diagnostic-error': {borderLeftColor: 'var(--error)'},
  '.cm-diagnostic-warning': {borderLeftColor: 'var(--warning)'},
});

// on.cursor(offset) is called when somebody moves the cursor; complete(file, offset, isExplicit) gives completions.
export function codePane(parent, on) {
  const shadow = parent.attachShadow({mode: 'open', delegatesFocus: true});
  const own = (run) => () => { run(); return true; };
  const HISTORY = [{key: 'Mod-z', run: own(() => on.undo()), preventDefault: true}, ...['Mod-y', 'Mod-Shift-z'].map((key) => ({key, run: own(() => on.redo()), preventDefault: true}))];
  let view = null, shown = null;

  function take(buffer, transactions) {
    if (view && shown === buffer) view.update(transactions);
    buffer.state = transactions.at(-1).state;
    for (const one of transactions) {
      if (!one.docChanged) continue;
      const edits = [];
      one.changes.iterChanges((start, end, _from, _to, text) => edits.push([start, end, text.toString()]));
      buffer.onchange(fromEdits(edits), one.annotation(Transaction.remote) === true);
    }
    if (shown === buffer && transactions.some((one) => one.selection && one.isUserEvent('select'))) on.cursor(buffer.state.selection.main.head);
  }

  class Buffer {
    constructor(text, file, language) {
      const words = async (context) => {
        const found = await on.complete(file, context.pos, context.explicit);
        if (!found?.length || context.aborted) return null;
        const options = found.map((one, index) => ({label: one.label, apply: one.text, boost: Math.max(99 - index, -99), detail: one.detail, info: one.documentation || undefined, type: {node: 'class', tree: 'class', key: 'variable'}[one.kind] ?? 'property'}));
        return {from: found[0].span[0], to: found[0].span[1], options, validFor: /^[\w:.@-]*$/};
      };
      this.state = EditorState.create({
        doc: text,
        extensions: [
          lineNumbers(), foldGutter(), lintGutter(), history({minDepth: 10000}), drawSelection(), highlightActiveLine(), highlightActiveLineGutter(), bracketMatching(), closeBrackets(),
          search({top: true}), autocompletion({override: [words]}), indentUnit.of(/^\t/m.test(text) ? '\t' : /\n {4}(?=\S)/.test(text) && !/\n {2}(?=\S)/.test(text) ? '    ' : '  '),
          LANGUAGES[language]?.() ?? [], syntaxHighlighting(COLORS), THEME,
          EditorView.contentAttributes.of({'aria-label': `text of ${file}`, tabindex: '0'}),
          keymap.of([...completionKeymap, ...searchKeymap.filter((one) => one.key !== 'Mod-Alt-\\'), ...HISTORY, ...foldKeymap, ...defaultKeymap.filter((one) => !['Alt-ArrowLeft', 'Alt-ArrowRight'].includes(one.key))]),
        ],
      });
    }

    get text() {
      if (this.doc !== this.state.doc) { this.doc = this.state.doc; this.string = this.doc.toString(); }
      return this.string;
    }

    apply(change, {isRemote = false, name = ''} = {}) {
      const changes = toEdits(change).map(([from, to, insert]) => ({from, to, insert}));
      const annotations = isRemote ? [Transaction.remote.of(true), Transaction.addToHistory.of(false)] : [isolateHistory.of('full'), Transaction.userEvent.of(`graph.${name}`)];
      take(this, [this.state.update({changes, annotations})]);
    }

    get depth() { return undoDepth(this.state); }
    undo() { return undo({state: this.state, dispatch: (one) => take(this, [one])}); }
    redo() { return redo({state: this.state, dispatch: (one) => take(this, [one])}); }
  }

  return {
    isPlain: false,
    buffer: (text, file, language) => new Buffer(text, file, language),
    show(buffer) {
      shown = buffer;
      if (view) view.setState(buffer.state);
      else view = new EditorView({state: buffer.state, parent: shadow, root: shadow, dispatchTransactions: (transactions) => take(shown, transactions)});
    },
    mark(buffer, findings) {
      const length = buffer.state.doc.length;
      const marks = findings.map((one) => ({
        from: Math.min(one.span[0], length), to: Math.min(Math.max(one.span[1], one.span[0]), length), severity: one.severity === 'error' ? 'error' : one.severity === 'info' ? 'info' : 'warning', message: one.message,
        actions: one.fixes.map((fix) => ({name: fix.title, apply: () => on.fix(one, fix)})),
      }));
      take(buffer, [buffer.state.update(setDiagnostics(buffer.state, marks))]);
    },
    select(start, end) {
      const length = shown.state.doc.length;
      const selection = EditorSelection.range(Math.min(start, length), Math.min(end, length));
      take(shown, [shown.state.update({selection, effects: EditorView.scrollIntoView(selection.from, {y: 'center'})})]);
    },
    offset: () => shown.state.selection.main.head,
    focus: () => view?.focus(),
    hasFocus: () => view?.hasFocus ?? false,
    // Two texts side by side; the right one can be edited. Returns {text(), show(span in the left one, span in the right one)}.
    merge(place, theirs, mine) {
      const root = place.attachShadow({mode: 'open'});
      const common = [lineNumbers(), THEME, syntaxHighlighting(COLORS)], named = (name) => EditorView.contentAttributes.of({'aria-label': name, tabindex: '0'});
      const made = new MergeView({a: {doc: theirs, extensions: [...common, named('text on disk, or before'), EditorState.readOnly.of(true)]}, b: {doc: mine, extensions: [...common, named('your text'), history(), keymap.of([...historyKeymap, ...defaultKeymap])]}, parent: root, root, revertControls: 'a-to-b', collapseUnchanged: {}, diffConfig: {scanLimit: 5000, timeout: 500}});
      const show = (view, span) => { if (span && span[1] <= view.state.doc.length) view.dispatch({selection: {anchor: span[0], head: span[1]}, effects: EditorView.scrollIntoView(span[0], {y: 'center'})}); };
      return {text: () => made.b.state.doc.toString(), show(left, right) { show(made.a, left); show(made.b, right); }};
    },
  };
}

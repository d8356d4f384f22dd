# SPDX-License-Identifier: BSD-3-Clause
"""Random gestures on a document, and what each of them must do to a plain model of nested lists."""

from __future__ import annotations

import copy
import difflib
import random
import re
from collections import Counter
from collections.abc import Callable
from typing import Any

from flexbt_core.behavior_tree.model.errors import Source
from flexbt_core.behavior_tree.xml.parser import Element, parse
from flexbt_studio.documents.text import applied, inverse
from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.errors import GestureError

Model = list[Any]
"""Tag, attributes, children."""

VALUES = (
    'a', '', '{key}', 'x && y', 'a < b', '"quoted" and \'single\'', 'two\nlines', '&lt; &amp; &#65; &unknown;', '&',
    ']]>', '-->', 'tab\there', 'ä→\U0001f600', '{=}', 'lt;', '>',
)  # fmt: skip
SNIPPETS = (
    '<Wait wait_duration="1.0"/>',
    '<Sequence>\n  <A x="1"/>\n  <Inverter>\n    <B/>\n  </Inverter>\n</Sequence>',
    '<!-- a note -->\n<A/>',
    '    <Fallback>\n\t<A/>\r\n    </Fallback>',
    '<A/><B/>',
    '<Script code="x := 1;\n  y := 2"/>',
    '<C><![CDATA[ < & ]]></C>',
)
_COMMENT = re.compile('<!--.*?-->', re.DOTALL)


def model_of(text: str) -> Model:
    """Return the elements of a text, as the engine's parser reads them."""
    top: Model = ['', {}, []]
    pending: list[tuple[Element, Model]] = [(parse(Source('', text)), top)]
    while pending:
        element, parent = pending.pop()
        made: Model = [element.tag, dict(element.attributes), []]
        parent[2].append(made)
        pending += [(child, made) for child in reversed(element.children)]
    return top


def comments_of(text: str) -> Counter[str]:
    """Return the comments of a text, without their indentation."""
    return Counter(re.sub(r'\s+', ' ', found) for found in _COMMENT.findall(text))


class Trial:
    """A document that random gestures edit one after another; each is checked."""

    def __init__(self, text: str, seed: int) -> None:
        self.text = text
        self.random = random.Random(seed)
        self.refused: Counter[str] = Counter()
        self.done: Counter[str] = Counter()

    def run(self, count: int) -> None:
        names = sorted(name for name in vars(Trial) if name.startswith('do_'))
        for _ in range(count):
            self.document = XmlDocument(self.text)
            self.before = model_of(self.text)
            self.after = copy.deepcopy(self.before)
            self.trees = [one for one in self.after[2][0][2] if one[0] == 'BehaviorTree']
            name = self.random.choice(names)
            doing: Callable[[], None] = getattr(self, name)
            try:
                doing()
            except GestureError:
                self.refused[name] += 1

    def gesture(self, name: str, /, **arguments: Any) -> None:
        """Do a gesture after the model was edited; check everything that holds for all gestures."""
        where = f'{name}({arguments})\n{self.text}'
        edits = self.document.gesture(name, arguments)
        text = applied(self.text, edits)
        assert applied(text, inverse(self.text, edits)) == self.text, where
        assert model_of(text) == self.after, f'{where}\n=== became\n{text}'
        assert not XmlDocument(text).problems
        if '\r\n' in self.text and '\n' not in self.text.replace('\r\n', ''):
            assert '\n' not in text.replace('\r\n', ''), where
        before, after = (Counter(line.strip() for line in one.splitlines()) for one in (self.text, text))
        self.lines = [*(before - after).elements()], [*(after - before).elements()]
        self.comments = comments_of(self.text), comments_of(text)
        self.where = f'{where}\n=== became\n{text}'
        self.done[name] += 1
        self.before_text, self.text = self.text, text

    def pick(self) -> tuple[str, Model, Model, int]:
        """Return path, node, parent and index of a random node."""
        labels = list(self.document.trees)
        nodes: list[tuple[str, Model, Model, int]] = []
        for label, tree in zip(labels, self.trees, strict=True):
            pending = [(label, tree)]
            for path, parent in pending:
                if parent[0] in ('SubTree', 'SubTreePlus') and any(child[0] == 'remap' for child in parent[2]):
                    continue
                for index, child in enumerate(parent[2]):
                    nodes.append((f'{path}/{index}', child, parent, index))
                    pending.append((f'{path}/{index}', child))
        if not nodes:
            raise GestureError('no nodes')
        return self.random.choice(nodes)

    def is_laid_out(self) -> bool:
        """Return whether each tag of the text before is on a line of its own, so that lines can be compared."""
        return re.search(r'>[ \t]*<|/?>[ \t]*[^\s<]|-->[ \t]*<', self.before_text) is None

    def do_set_value(self) -> None:
        path, node, _, _ = self.pick()
        name = self.random.choice([*node[1], 'new_port', '_skipIf', 'name'])
        value = self.random.choice(VALUES)
        is_there = name in node[1]
        node[1][name] = value
        self.gesture('set_value', node=path, name=name, value=value)
        assert self.comments[0] == self.comments[1] or '-->' in value
        gone, new = self.lines
        if '\n' not in self.before_text[slice(*self.span_of(path, name))] and is_there:
            assert len(gone) <= 1 and len(new) <= 1, self.where

    def span_of(self, path: str, name: str) -> tuple[int, int]:
        part = self.document.at(path).parts.get(name)
        return (0, 0) if part is None else (part.start, part.end)

    def do_remove_value(self) -> None:
        path, node, _, _ = self.pick()
        if not node[1]:
            return
        name = self.random.choice([*node[1]])
        del node[1][name]
        self.gesture('set_value', node=path, name=name, value=None)

    def do_rename_attribute(self) -> None:
        path, node, _, _ = self.pick()
        if node[1]:
            name = self.random.choice([*node[1]])
            node[1] = {'other' if key == name else key: value for key, value in node[1].items()}
            self.gesture('rename_attribute', node=path, name=name, new='other')

    def do_set_type(self) -> None:
        path, node, _, _ = self.pick()
        tag, attributes, _ = node
        form = self.random.choice([None, '', 'Action', 'SubTree'])
        keep = self.random.choice([None, [], [*attributes][:1]])
        explicit = tag in ('Action', 'Condition', 'Control', 'Decorator', 'SubTree', 'SubTreePlus')
        wanted = (tag if explicit else '') if form is None else form
        kept = {
            name: value
            for name, value in attributes.items()
            if keep is None or name in keep or name in ('ID', 'name') or name.startswith('_')
        }
        if wanted:
            kept['ID'] = 'NewType'
        elif explicit:
            kept.pop('ID', None)
        node[0], node[1] = wanted or 'NewType', kept
        self.gesture('set_type', node=path, type='NewType', keep=keep, form=form)
        assert self.comments[0] == self.comments[1]

    def do_add_node(self) -> None:
        path, node, _, _ = self.pick()
        index = self.random.randint(0, len(node[2]))
        snippet = self.random.choice(SNIPPETS)
        was_empty = not node[2]
        node[2][index:index] = model_of(f'<root>{snippet}</root>')[2][0][2]
        self.gesture('add_node', parent=path, index=index, xml=snippet)
        if self.is_laid_out() and not was_empty:
            assert not self.lines[0], self.where

    def do_add_and_remove(self) -> None:
        path, node, _, _ = self.pick()
        if not node[2]:
            return
        index = self.random.randint(0, len(node[2]))
        start = self.text
        node[2].insert(index, ['X', {}, []])
        self.gesture('add_node', parent=path, index=index, xml='<X/>')
        self.document = XmlDocument(self.text)
        del node[2][index]
        self.gesture('remove', node=f'{path}/{index}')
        if self.is_laid_out():
            assert self.text == start, self.where

    def do_remove(self) -> None:
        path, _, parent, index = self.pick()
        del parent[2][index]
        self.gesture('remove', node=path)
        if self.is_laid_out() and parent[2]:
            assert not self.lines[1], self.where

    def do_move(self) -> None:
        path, node, parent, index = self.pick()
        other, target, _, _ = self.pick()
        if f'{other}/'.startswith(f'{path}/'):
            try:
                self.document.gesture('move', {'node': path, 'parent': other, 'index': 0})
            except GestureError:
                return
            raise AssertionError('a node was moved into itself')
        del parent[2][index]
        place = self.random.randint(0, len(target[2]))
        opens, closes = not target[2], not parent[2] and target is not parent
        target[2].insert(place, node)
        self.gesture('move', node=path, parent=other, index=place)
        assert self.comments[0] == self.comments[1], self.where
        if self.is_laid_out() and not opens and not closes:
            gone, new = ([line for line in lines if line] for lines in self.lines)
            assert not gone and not new, self.where

    def do_wrap(self) -> None:
        path, node, parent, index = self.pick()
        values = self.random.choice([{}, {'num_attempts': '3'}, {'if': 'a < "b"'}])
        parent[2][index] = ['Retry', values, [node]]
        before = self.text
        self.gesture('wrap', node=path, xml_type='Retry', values=values)
        assert self.comments[0] == self.comments[1]
        if self.is_laid_out():
            assert not self.lines[0] and len(self.lines[1]) == 2, self.where
        self.document = XmlDocument(self.text)
        parent[2][index] = node
        self.gesture('unwrap', node=path)
        if self.is_laid_out():
            assert self.text == before, self.where

    def do_unwrap(self) -> None:
        path, node, parent, index = self.pick()
        parent[2][index : index + 1] = node[2]
        self.gesture('unwrap', node=path)

    def do_comment(self) -> None:
        path, _, _, _ = self.pick()
        text = self.random.choice(['one', 'two\nlines', 'ä & <b>', None])
        note = self.document.view()['nodes']
        before = next(one['note'] for one in note if one['path'] == path)
        self.gesture('set_comment', node=path, text=text)
        after = XmlDocument(self.text).view()['nodes']
        if text is not None:
            assert next(one['note'] for one in after if one['path'] == path) == text, self.where
        elif before:
            assert sum(self.comments[1].values()) < sum(self.comments[0].values())

    def do_copy(self) -> None:
        path, node, parent, index = self.pick()
        clip = self.document.clip(path)
        assert '\r' not in clip.replace('&#13;', '')
        parent[2].insert(index, copy.deepcopy(node))
        if parent[0] == 'BehaviorTree':
            return
        self.gesture('add_node', parent=path.rpartition('/')[0], index=index, xml=clip)

    def do_add_tree(self) -> None:
        id = f'New{self.random.randint(0, 5)}'
        xml = self.random.choice([None, SNIPPETS[1], SNIPPETS[2]])
        below = [] if xml is None else model_of(f'<root>{xml}</root>')[2][0][2]
        sections = self.after[2][0][2]
        places = [index for index, one in enumerate(sections, 1) if one[0] == 'BehaviorTree']
        places = places or [index for index, one in enumerate(sections, 1) if one[0] == 'include'] or [0]
        sections.insert(places[-1], ['BehaviorTree', {'ID': id}, below])
        self.gesture('add_tree', id=id, xml=xml)

    def do_remove_tree(self) -> None:
        if len(self.trees) > 1:
            index = self.random.randrange(len(self.trees))
            sections = self.after[2][0][2]
            sections[:] = [one for one in sections if one is not self.trees[index]]
            self.gesture('remove_tree', id=list(self.document.trees)[index])

    def do_rename_tree(self) -> None:
        if not self.trees:
            return
        index = self.random.randrange(len(self.trees))
        old = self.trees[index][1].get('ID')
        is_alone = sum(one[1].get('ID') == old for one in self.trees) == 1
        self.trees[index][1]['ID'] = 'Renamed'
        root = self.after[2][0]
        if old is not None and is_alone:
            if root[1].get('main_tree_to_execute') == old:
                root[1]['main_tree_to_execute'] = 'Renamed'
            pending = [one for one in root[2] if one[0] in ('BehaviorTree', 'TreeNodesModel')]
            for one in pending:
                pending += one[2]
                if one[0] in ('SubTree', 'SubTreePlus') and one[1].get('ID') == old:
                    one[1]['ID'] = 'Renamed'
        self.gesture('rename_tree', id=list(self.document.trees)[index], new='Renamed')
        gone, new = self.lines
        assert len(gone) == len(new)

    def do_include(self) -> None:
        sections = self.after[2][0][2]
        places = [index for index, one in enumerate(sections, 1) if one[0] == 'include'] or [0]
        if len(places) > 1 and self.random.random() < 0.5:
            index = places[-1] - 1
            path = sections[index][1].get('path')
            found = next(one for one in sections if one[0] == 'include' and one[1].get('path') == path)
            sections[:] = [one for one in sections if one is not found]
            self.gesture('remove_include', path=path)
        else:
            sections.insert(places[-1], ['include', {'ros_pkg': 'pkg', 'path': 'a.xml'}, []])
            self.gesture('add_include', path='a.xml', package='pkg')

    def do_model(self) -> None:
        sections = self.after[2][0][2]
        section = next((one for one in sections if one[0] == 'TreeNodesModel'), None)
        if section is not None and section[2] and self.random.random() < 0.5:
            id = section[2][0][1].get('ID')
            del section[2][0]
            if not section[2]:
                sections[:] = [one for one in sections if one is not section]
            self.gesture('remove_model', id=id)
            return
        id = f'Model{self.random.randint(0, 3)}'
        new: Model = ['Action', {'ID': id}, [['input_port', {'name': 'x', 'default': '<1>'}, []]]]
        if section is None:
            section = ['TreeNodesModel', {}, []]
            sections.append(section)
        section[2].append(new)
        port = {'name': 'x', 'direction': 'input', 'default': '<1>', 'description': 'less < & more'}
        self.gesture('add_model', id=id, kind='Action', ports=[port])
        models = {one['id']: one for one in XmlDocument(self.text).view()['models']}
        assert models[id]['ports'][0]['description'] == 'less < & more'


def shown(before: str, after: str) -> str:
    """Return a diff for a message."""
    return ''.join(difflib.unified_diff(before.splitlines(True), after.splitlines(True)))

"""
Changes of numbers in an XML file that leave every other byte as it is.

A parser gives the places of the elements in the bytes of the file. Attributes are replaced, or
new elements inserted, there; comments, order and layout remain.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
import re
from xml.parsers import expat

from gravity_comp_ros.errors import DataError
from gravity_comp_ros.printable import printable


@dataclass
class Element:
    """
    An element with its places in the file.

    `start` and `stop` enclose its start tag; `close` is the place of its end tag, None for
    `<tag/>`.
    """

    tag: str
    attributes: dict[str, str]
    start: int
    stop: int
    close: int | None = None
    children: list[Element] = field(default_factory=list)

    def child(self, tag: str) -> Element | None:
        """Return the first child of this tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def descendants(self) -> Iterator[Element]:
        """Yield all elements within, parents first."""
        for child in self.children:
            yield child
            yield from child.descendants()


class XmlEdit:
    """
    A file and the changes of it.

    :raises DataError: if it is not XML, or its bytes are not ASCII-compatible.
    """

    def __init__(self, data: bytes, source: str) -> None:
        if data[:2] in (b'\xff\xfe', b'\xfe\xff') or b'\0' in data[:4]:
            raise DataError(f'{source} is encoded in UTF-16: convert it to UTF-8 first')
        self._data, self._changes = data, list[tuple[int, int, bytes]]()
        # XML allows nothing before `<?xml`, but files have it.
        self._offset = len(data) - len(data.lstrip(b'\xef\xbb\xbf \t\r\n'))
        self.root = self._parsed(source)

    def set(self, element: Element, name: str, value: str) -> None:
        """Set an attribute of an element."""
        tag = self._data[element.start:element.stop]
        pattern = rb'(?<=[\s"\'])' + re.escape(name.encode()) + rb'\s*=\s*("[^"]*"|\'[^\']*\')'
        match = re.search(pattern, tag)
        if match is not None:
            first, last = match.span(1)
            self._change(element.start + first + 1, element.start + last - 1, value)
        else:
            end = element.stop - (2 if tag.endswith(b'/>') else 1)
            end -= len(self._data[:end]) - len(self._data[:end].rstrip())
            self._change(end, end, f' {name}="{value}"')

    def insert(self, parent: Element, text: str) -> None:
        """Insert elements as the first ones within another, on a line of their own."""
        line = self._data[:parent.start].rpartition(b'\n')[2]
        indent = line[:len(line) - len(line.lstrip())].decode()
        if parent.close is not None:
            child = parent.children[0].start if parent.children else parent.close
            before = self._data[:child].rpartition(b'\n')[2]
            own = before.decode() if parent.children and not before.strip() else f'{indent}  '
            self._change(parent.stop, parent.stop, f'\n{own}{text}')
        else:
            self._change(parent.stop - 2, parent.stop,
                         f'>\n{indent}  {text}\n{indent}</{parent.tag}>')

    def result(self) -> bytes:
        """Return the changed file."""
        data = self._data
        for first, last, value in sorted(self._changes, reverse=True):
            data = data[:first] + value + data[last:]
        return data

    def _change(self, first: int, last: int, value: str) -> None:
        self._changes.append((first, last, value.encode()))

    def _parsed(self, source: str) -> Element:
        parser = expat.ParserCreate()
        open_elements = [Element('', {}, 0, 0)]

        def start(tag: str, attributes: dict[str, str]) -> None:
            first = parser.CurrentByteIndex + self._offset
            element = Element(tag.rpartition(':')[2], attributes, first, self._end(first))
            open_elements[-1].children.append(element)
            open_elements.append(element)

        def end(tag: str) -> None:
            element, place = open_elements.pop(), parser.CurrentByteIndex + self._offset
            # The end of `<tag/>` is reported at the tag itself.
            if self._data[place:place + 2] == b'</':
                element.close = place

        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            parser.Parse(self._data[self._offset:], True)
        except expat.ExpatError as problem:
            raise DataError(f'{source} is not XML: {printable(str(problem))}') from problem
        return open_elements[0].children[0]

    def _end(self, first: int) -> int:
        """Return the end of the start tag at a place; a quoted `>` does not end it."""
        match = re.compile(rb'<(?:[^"\'>]|"[^"]*"|\'[^\']*\')*>').match(self._data, first)
        return match.end() if match else first


def number(value: float) -> str:
    """Return a number with ten digits and twelve decimals."""
    return f'{round(value, 12):.10g}'

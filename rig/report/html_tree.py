"""A page of this program's HTML as a tree, for writers of other formats."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = frozenset({"br", "meta"})
SILENT = frozenset({"style", "head", "title", "script"})


@dataclass
class Node:
    """An element: tag, attributes, and what is in it (elements and texts in their order)."""

    tag: str
    attributes: dict[str, str] = field(default_factory=dict)
    children: list[Node | str] = field(default_factory=list)

    @property
    def kinds(self) -> frozenset[str]:
        """Its classes."""
        return frozenset(self.attributes.get("class", "").split())

    def elements(self, *tags: str) -> Iterator[Node]:
        """The elements directly in it; of these tags, where some are given."""
        return (one for one in self.children if isinstance(one, Node) and (not tags or one.tag in tags))

    def everywhere(self, tag: str) -> Iterator[Node]:
        """The elements of a tag anywhere in it."""
        for one in self.elements():
            if one.tag == tag:
                yield one
            yield from one.everywhere(tag)

    @property
    def text(self) -> str:
        """All its text."""
        return "".join(one if isinstance(one, str) else one.text for one in self.children)


class _Builder(HTMLParser):
    """Builds the tree; an end without a beginning is passed over."""

    def __init__(self) -> None:
        super().__init__()
        self.root = Node("")
        self._open = [self.root]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        node = Node(tag, {name: value or "" for name, value in attrs})
        self._open[-1].children.append(node)
        if tag not in VOID:
            self._open.append(node)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._open[-1].children.append(Node(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        names = [node.tag for node in self._open]
        if tag in names[1:]:
            del self._open[len(names) - 1 - names[::-1].index(tag):]

    def handle_data(self, data: str) -> None:
        self._open[-1].children.append(data)


def tree_of(page: str) -> Node:
    """The tree of a page; its `<main>` where it has one."""
    builder = _Builder()
    builder.feed(page)
    builder.close()
    return next(builder.root.everywhere("main"), builder.root)

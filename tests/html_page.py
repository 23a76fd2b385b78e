"""A page of HTML taken apart by the standard library's parser."""

from __future__ import annotations

from html.parser import HTMLParser

VOID = {"meta", "img", "br", "input", "link"}


class Page(HTMLParser):
    """The elements of a page: checks that they nest, gathers ids, sources, words and attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.sources: list[str] = []
        self.words: list[str] = []
        self.count: dict[str, int] = {}
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.count[tag] = self.count.get(tag, 0) + 1
        self.elements.append((tag, {name: str(value) for name, value in attrs}))
        for name, value in attrs:
            if name == "id":
                self.ids.append(str(value))
            if name in ("src", "href", "xlink:href", "srcset"):
                self.sources.append(str(value))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def attributes(self, tag: str) -> list[dict[str, str]]:
        """Of each element with this tag."""
        return [attributes for name, attributes in self.elements if name == tag]

    def assert_self_contained(self) -> None:
        """Nothing is fetched, nothing runs, and every name that is pointed at is there."""
        assert all(source.startswith(("data:image/", "#")) for source in self.sources)
        assert not {"script", "iframe", "object", "embed", "link", "base"} & self.count.keys()
        assert {source[1:] for source in self.sources if source[0] == "#"} <= set(self.ids)
        assert len(self.ids) == len(set(self.ids))

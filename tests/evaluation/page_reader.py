"""A parser that reads pages as a browser does."""

from html.parser import HTMLParser

EMPTY = {"br", "img", "meta", "line", "polyline", "path"}  # elements without an end


class Reader(HTMLParser):
    """Collects elements and text, and checks that every opened element is closed."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open, self.found, self.text = [], [], ""
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += f"{data} "

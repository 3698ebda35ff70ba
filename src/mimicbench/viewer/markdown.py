"""Text of others in the page's panels, which render Markdown and HTML."""


def plain(line: str) -> str:
    """A line without what Markdown or HTML would take for its own."""
    return "".join(f"\\{sign}" if sign in "\\`*_{}[]<>#|!" else sign for sign in line)

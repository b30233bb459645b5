"""Safe printing of untrusted text to a terminal."""


def printable(text: str) -> str:
    """Escape control characters, line breaks and text-direction marks, for example as `\\x1b`."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)

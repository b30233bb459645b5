"""Text from files on the terminal."""


def printable(text: str) -> str:
    """Return the text with control characters (also line ends and marks of direction) as escapes such as `\\x1b`."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)

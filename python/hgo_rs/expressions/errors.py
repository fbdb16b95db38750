"""What is wrong with an expression, and where."""

from __future__ import annotations

from hgo_rs.errors import HgoError, printable

_WINDOW = 60  # characters of a long text shown around the place


class ExpressionError(HgoError):
    """An expression that is refused; `position` is the index of the place in `text`, if known."""

    def __init__(
        self, message: str, text: str | None = None, position: int | None = None, name: str = ""
    ) -> None:
        self.reason = message
        self.text = text
        self.position = position
        self.name = name
        super().__init__(self._shown())

    def __str__(self) -> str:
        return "\n".join(map(printable, ValueError.__str__(self).split("\n")))

    def _shown(self) -> str:
        head = f"{self.name}: {self.reason}" if self.name else self.reason
        if self.text is None or self.position is None:
            return head
        return f"{head}\n{caret(self.text, self.position)}"

    def of(self, name: str) -> ExpressionError:
        """The same error, of the expression called ``name``."""
        return ExpressionError(self.reason, self.text, self.position, name)

    def __reduce__(self) -> tuple[type, tuple[str, str | None, int | None, str]]:
        return ExpressionError, (self.reason, self.text, self.position, self.name)


class UntraceableError(HgoError):
    """A callable that needs the value of a symbolic argument (a branch, `float(x)`, `math.sin`)."""


def caret(text: str, position: int) -> str:
    """The line of ``text`` around ``position``, and a caret under the place."""
    begin = text.rfind("\n", 0, position) + 1
    end = text.find("\n", position)
    end = len(text) if end < 0 else end
    first = max(begin, position - _WINDOW)
    last = min(end, position + _WINDOW)
    before = "..." if first > begin else ""
    after = "..." if last < end else ""
    line = "".join(c if c.isprintable() else " " for c in text[first:last])
    return f"    {before}{line}{after}\n    {' ' * (len(before) + position - first)}^"

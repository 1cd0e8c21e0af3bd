"""Sets of numbers whose size does not grow with the log."""

from bisect import bisect_right


class Numbers:
    """A set of numbers, stored as ranges: compact if most numbers arrive in order."""

    def __init__(self) -> None:
        self._starts: list[int] = []
        self._ends: list[int] = []
        """Range k goes from _starts[k] up to, but not including, _ends[k]."""

    def __contains__(self, number: int) -> bool:
        k = bisect_right(self._starts, number) - 1
        return k >= 0 and number < self._ends[k]

    def add(self, number: int) -> bool:
        """Add a number; returns whether it is new."""
        if self._ends and self._ends[-1] == number:  # most come in order
            self._ends[-1] = number + 1
            return True
        k = bisect_right(self._starts, number) - 1
        if k >= 0 and number < self._ends[k]:
            return False
        after = k >= 0 and self._ends[k] == number
        before = k + 1 < len(self._starts) and self._starts[k + 1] == number + 1
        if after and before:
            self._ends[k] = self._ends.pop(k + 1)
            del self._starts[k + 1]
        elif after:
            self._ends[k] = number + 1
        elif before:
            self._starts[k + 1] = number
        else:
            self._starts.insert(k + 1, number)
            self._ends.insert(k + 1, number + 1)
        return True

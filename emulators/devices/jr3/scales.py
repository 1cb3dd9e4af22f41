"""Falsification of a device's full scales."""

from collections.abc import Mapping, Sequence

from emulators.faults.ledger import Handler, Injection

_WORD_LIMIT = 65535
_FORCES = 3


class WrongScales:
    """Falsifies the six reported full scales while a fault is active."""

    def __init__(self) -> None:
        self._faults: list[Injection] = []
        self.handlers: Mapping[str, Handler] = {"wrong-scales": Handler(self._faults.append)}
        """Fault handlers for a ledger."""

    @property
    def faulty(self) -> bool:
        """Whether the reported full scales differ from the true ones."""
        self._faults = [injection for injection in self._faults if injection.ended_at is None]
        return bool(self._faults)

    def falsified(self, words: Sequence[int]) -> tuple[int, ...]:
        """Return the full scales as falsified, forces first. `words` are all true full scales, or the first ones."""
        falsified = tuple(words)
        for injection in self._faults:
            which, before = injection.values["of"], falsified
            falsified = tuple(
                min(round(word * injection.number("factor")), _WORD_LIMIT)
                if which == "all" or (which == "forces") == (k < _FORCES)
                else word
                for k, word in enumerate(falsified)
            )
            injection.struck += falsified != before
        return falsified

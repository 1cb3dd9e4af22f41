"""Full scales that a device tells wrongly."""

from collections.abc import Mapping, Sequence

from emulators.faults.ledger import Handler, Injection

_WORD_LIMIT = 65535
_FORCES = 3


class WrongScales:
    """Falsifies the six full scales that are told while a fault lasts."""

    def __init__(self) -> None:
        self._faults: list[Injection] = []
        self.handlers: Mapping[str, Handler] = {"wrong-scales": Handler(self._faults.append)}
        """Handlers for a ledger."""

    @property
    def faulty(self) -> bool:
        """Whether other full scales are told than the true ones."""
        self._faults = [injection for injection in self._faults if injection.ended_at is None]
        return bool(self._faults)

    def told(self, words: Sequence[int]) -> tuple[int, ...]:
        """Return the falsified full scales, forces first, for all or the first of the true ones."""
        told = tuple(words)
        for injection in self._faults:
            which, before = injection.values["of"], told
            told = tuple(
                min(round(word * injection.number("factor")), _WORD_LIMIT)
                if which == "all" or (which == "forces") == (k < _FORCES)
                else word
                for k, word in enumerate(told)
            )
            injection.struck += told != before
        return told

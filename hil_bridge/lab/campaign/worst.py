"""Worst run of a campaign, with its recording for a picture."""

from collections.abc import Sequence
from typing import NamedTuple

from hil_bridge.errors import BridgeError
from hil_bridge.lab.campaign.digest import true_force, worst_first
from hil_bridge.lab.campaign.judging import attempt
from hil_bridge.lab.campaign.repeating import compare_run, repeat_of
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.record import Recording, read

_REPEAT_MOST_S = 30.0
"""Largest computing time of a run that a page repeats for its picture, s. Chosen."""


class WorstRecording(NamedTuple):
    """Recording of a run, with its origin."""

    recording: Recording
    origin: str
    """Where the recording comes from, as a sentence."""


def worst_run(store: Store, runs: Sequence[Done]) -> Done | None:
    """Return the result of a hunt, otherwise the worst failed run, otherwise the run with the largest true force."""
    for run in store.runs("key = ?", [store.fact("worst")]):
        return run
    failed = worst_first(store.plan().criteria, runs)
    return failed[0] if failed else max(runs, key=true_force, default=None)


def recording_of(store: Store, run: Done) -> WorstRecording | None:
    """Return the stored recording of a run. If there is none, repeat the run in virtual time.

    Returns None for a run that takes too long, or that cannot be repeated here.
    """
    place = store.folder / run.recording
    if run.recording and place.is_file():
        try:
            return WorstRecording(read(place), "From the recording of the run.")
        except BridgeError:  # another version wrote it
            pass
    if run.wall_s > _REPEAT_MOST_S:
        return None
    repeat = repeat_of(store.plan(), run)
    new = attempt(repeat.job)
    if new.result is None:
        return None
    count = len(compare_run(repeat, new).differences)
    equal = f"figures that differ from the results: {count}" if count else "all figures are the same"
    return WorstRecording(new.result.recording, f"The run was repeated for this picture; {equal}.")

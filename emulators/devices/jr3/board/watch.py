"""Monitoring of words selected by the host: rate, peaks, load envelopes."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board.traces import COLUMNS, Traces, Words, pieces
from protocol.devices.jr3.board import LoadEnvelope

WATCHED = 8
"""Number of consecutive words that are monitored for rate and peaks."""


def series(
    traces: Traces, constants: Mapping[int, int], address: int, samples: NDArray[np.int64]
) -> NDArray[np.int16]:
    """Return a word after each of the given samples. A word that is not computed keeps its value."""
    name, word = COLUMNS.get(address, ("", 0))
    if name in traces:
        return traces[name].at(word, samples)
    return np.full(len(samples), constants.get(address, 0), np.int16)


def watched(
    traces: Traces, constants: Mapping[int, int], address: int, samples: NDArray[np.int64]
) -> NDArray[np.int16]:
    """Return eight consecutive words (8, n) after each of the given samples."""
    words = np.empty((WATCHED, len(samples)), np.int16)
    chosen = [piece for piece in pieces(address, WATCHED) if piece.trace in traces]
    if sum(piece.end - piece.begin for piece in chosen) < WATCHED:
        words[:] = [[constants.get(address + i, 0)] for i in range(WATCHED)]
    for piece in chosen:
        trace = traces[piece.trace]
        part = slice(piece.offset, piece.offset + piece.end - piece.begin)
        words[part] = trace.values[piece.begin : piece.end, trace.columns(samples)]
    return words


def peaks(
    traces: Traces, constants: Mapping[int, int], address: int, start: int, end: int
) -> tuple[Words, Words]:
    """Return the lowest and highest values (8,) of eight consecutive words after samples `start` … `end` − 1."""
    still = [constants.get(address + i, 0) for i in range(WATCHED)]
    lowest, highest = np.array(still, np.int16), np.array(still, np.int16)
    for piece in pieces(address, WATCHED):
        trace = traces[piece.trace]
        values = trace.values[piece.begin : piece.end, trace.index(start) : trace.index(end - 1) + 1]
        part = slice(piece.offset, piece.offset + piece.end - piece.begin)
        np.minimum.reduce(values, axis=1, out=lowest[part])
        np.maximum.reduce(values, axis=1, out=highest[part])
    return lowest, highest


def latch(
    traces: Traces,
    constants: Mapping[int, int],
    envelope: LoadEnvelope,
    ticks: NDArray[np.int64],
    previous_bits: int,
) -> NDArray[np.int64]:
    """Return the word threshold_bits after each tick. Latched bits of the previous word remain set."""
    bits = np.zeros(len(ticks), np.int64)
    for item in envelope.at_least:
        reached = series(traces, constants, item.data_address, ticks) >= item.threshold
        bits |= np.where(reached, item.bit_pattern, 0)
    for item in envelope.at_most:
        reached = series(traces, constants, item.data_address, ticks) <= item.threshold
        bits |= np.where(reached, item.bit_pattern, 0)
    latched = np.bitwise_or.accumulate(bits & envelope.latch_bits) | (previous_bits & envelope.latch_bits)
    return latched | bits & ~envelope.latch_bits

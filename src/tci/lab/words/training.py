"""Trains networks for touch words, in plain NumPy: a minute for some thousand touches."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tci.capabilities.touch_words.recogniser import CLIP, Recogniser
from tci.lab.words.examples import Examples
from tci.messages.frames import Array, read_only

HIDDEN, NETS = 48, 5
"""Size and number of the networks. Assumed: with half of each, 1 % more of the words are wrong."""
EPOCHS, BATCH, RATE, DECAY = 60, 64, 3e-3, 1e-3
NOISE = 0.2
"""Noise on the features, in standard deviations: what a skin or a person adds that no training has."""
_BETA = 0.9, 0.999


def train(
    features: Array, told: Sequence[str], words: Sequence[str], *, trained_on: str = "", seed: int = 0
) -> Recogniser:
    """A recogniser that tells `words` from `features` (t, n) of touches that were `told`.

    By Adam (Kingma and Ba 2015), with a rate that falls as a cosine. Equal arguments give an equal one.
    """
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-3
    values = np.clip((features - mean) / scale, -CLIP, CLIP)
    target = np.array([words.index(word) for word in told])
    count = np.bincount(target, minlength=len(words))
    share = (1.0 / np.maximum(count, 1.0))[target] ** 0.5
    share /= share.mean()
    nets = [_train_one(values, target, share, len(words), np.random.default_rng([seed, number]))
            for number in range(NETS)]  # fmt: skip
    weights = tuple(read_only(np.stack([net[k] for net in nets])) for k in range(3))
    biases = tuple(read_only(np.stack([net[k] for net in nets])[:, None]) for k in range(3, 6))
    return Recogniser(tuple(words), read_only(mean), read_only(scale), weights, biases, trained_on)


def _train_one(
    values: Array, target: NDArray[np.intp], share: Array, words: int, random: np.random.Generator
) -> list[Array]:
    sizes = [values.shape[1], HIDDEN, HIDDEN, words]
    ends = list(pairwise(sizes))
    own = [random.normal(0.0, np.sqrt(2.0 / a), (a, b)) for a, b in ends] + [np.zeros(b) for _, b in ends]
    first, second = ([np.zeros_like(one) for one in own] for _ in range(2))
    batch = min(BATCH, len(values))
    each = len(values) // batch
    for step in range(EPOCHS * each):
        if step % each == 0:
            order = random.permutation(len(values))
        rows = order[step % each * batch : (step % each + 1) * batch]
        inputs = values[rows] + random.normal(0.0, NOISE, (len(rows), values.shape[1]))
        slopes = _slopes(own, inputs, target[rows], share[rows] / len(rows))
        rate = RATE * 0.5 * (1.0 + np.cos(np.pi * step / (EPOCHS * each)))
        for k, slope in enumerate(slopes):
            first[k] += (1.0 - _BETA[0]) * (slope - first[k])
            second[k] += (1.0 - _BETA[1]) * (slope * slope - second[k])
            way = first[k] / (1.0 - _BETA[0] ** (step + 1))
            way /= np.sqrt(second[k] / (1.0 - _BETA[1] ** (step + 1))) + 1e-8
            own[k] = own[k] - rate * (way + (DECAY * own[k] if k < 3 else 0.0))
    return own


def _slopes(own: list[Array], inputs: Array, target: NDArray[np.intp], share: Array) -> list[Array]:
    """Slopes of the weighted cross-entropy, for weights and biases."""
    one = np.maximum(inputs @ own[0] + own[3], 0.0)
    two = np.maximum(one @ own[1] + own[4], 0.0)
    out = two @ own[2] + own[5]
    out = np.exp(out - out.max(axis=1, keepdims=True))
    out /= out.sum(axis=1, keepdims=True)
    out[np.arange(len(target)), target] -= 1.0
    out *= share[:, None]
    back_two = (out @ own[2].T) * (two > 0.0)
    back_one = (back_two @ own[1].T) * (one > 0.0)
    return [
        inputs.T @ back_one, one.T @ back_two, two.T @ out,
        back_one.sum(axis=0), back_two.sum(axis=0), out.sum(axis=0),
    ]  # fmt: skip


def left_out(examples: Examples, *, seed: int = 0) -> dict[str, float]:
    """Fraction of right words for each group, by a recogniser that was trained without it; empty for one
    group."""
    groups = np.array(examples.groups)
    names = list(dict.fromkeys(examples.groups))
    told = np.array(examples.words)
    scores: dict[str, float] = {}
    for name in names if len(names) > 1 else ():
        own = groups == name
        words = tuple(dict.fromkeys(told[~own].tolist()))
        if len(words) < 2:
            continue
        net = train(examples.features[~own], told[~own].tolist(), words, seed=seed)
        best = net.probabilities(examples.features[own]).argmax(axis=1)
        scores[name] = float((np.array(words)[best] == told[own]).mean())
    return scores

"""What tells the words: a few small networks that vote, in a file that people train anew.

The file is a NumPy archive (`.npz`) without code: the words, the names of the features, their means and
scales, and the weights of the networks.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.capabilities.touch_words.features import NAMES
from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array, read_only

OTHER = "other"
"""What is told of a touch that means nothing: somebody leans, a sleeve, a bump."""
CLIP = 4.0
"""Standard deviations beyond which a feature is not followed: nothing was learnt there."""
VERSION = 1
LAYERS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Recogniser:
    """Networks that tell words: e networks from n features over two layers of h units to w words."""

    words: tuple[str, ...]
    mean: Array
    """Of each feature (n,)."""
    scale: Array
    """Standard deviation of each feature (n,)."""
    weights: tuple[Array, ...]
    """(e, n, h), (e, h, h), (e, h, w)."""
    biases: tuple[Array, ...]
    """(e, 1, h), (e, 1, h), (e, 1, w)."""
    trained_on: str = ""
    """In words, for people who use the file."""

    def probabilities(self, features: Array) -> Array:
        """Probability (t, w) of each word for touches with `features` (t, n)."""
        value: Array = np.clip((features - self.mean) / self.scale, -CLIP, CLIP)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            value = np.maximum(value @ weight + bias, 0.0)
        value = value @ self.weights[-1] + self.biases[-1]
        value = np.exp(value - value.max(axis=-1, keepdims=True))
        value /= value.sum(axis=-1, keepdims=True)
        return read_only(value.mean(axis=0))

    def save(self, path: str | Path) -> None:
        """Writes the file, with numbers of 32 bits."""
        arrays: dict[str, NDArray[Any]] = {
            "version": np.array(VERSION), "features": np.array(NAMES), "words": np.array(self.words),
            "trained_on": np.array(self.trained_on), "mean": self.mean.astype(np.float32),
            "scale": self.scale.astype(np.float32),
        }  # fmt: skip
        for number, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays[f"weight{number}"] = weight.astype(np.float32)
            arrays[f"bias{number}"] = bias.astype(np.float32)
        with Path(path).open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]


def read_recogniser(path: str | Path) -> Recogniser:
    """Raises DescriptionError if the file is not a recogniser of this version."""
    try:
        if not Path(path).is_file():
            raise ValueError("there is no such file; valid: one from tci words train")
        if not zipfile.is_zipfile(path):
            raise ValueError("it is no .npz file; valid: one from tci words train")
        with np.load(path, allow_pickle=False) as file:
            arrays: dict[str, NDArray[Any]] = dict(file)
        if int(arrays["version"]) != VERSION or tuple(arrays["features"].tolist()) != NAMES:
            raise ValueError("it was made for other features; valid: one from tci words train")
        return _checked(arrays)
    except (OSError, KeyError, ValueError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        raise DescriptionError(str(path), [Fault(0, f"no recogniser of touch words: {error}")]) from None


def _checked(arrays: Mapping[str, NDArray[Any]]) -> Recogniser:
    weights = tuple(read_only(arrays[f"weight{number}"]) for number in range(LAYERS))
    biases = tuple(read_only(arrays[f"bias{number}"]) for number in range(LAYERS))
    mean, scale = read_only(arrays["mean"]), read_only(arrays["scale"])
    words = tuple(str(word) for word in arrays["words"].tolist())
    nets, width = (weights[0].shape[0], weights[0].shape[-1]) if weights[0].ndim == 3 else (0, 0)
    sizes = (len(NAMES), width, width, len(words))
    for number, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
        shapes = (nets, *sizes[number : number + 2]), (nets, 1, sizes[number + 1])
        if (weight.shape, bias.shape) != shapes:
            raise ValueError(f"layer {number} of shapes {weight.shape}, {bias.shape}; valid: {shapes}")
    if mean.shape != (len(NAMES),) or scale.shape != mean.shape or not (scale > 0.0).all():
        raise ValueError(f"means and scales; valid: {len(NAMES)} each, scales above 0")
    if not all(np.isfinite(one).all() for one in (*weights, *biases, mean, scale)):
        raise ValueError("numbers that are not finite")
    return Recogniser(words, mean, scale, weights, biases, str(arrays["trained_on"]))

"""Policies in ONNX files (extra `onnx`), with all that TCI needs to know in the file's metadata."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tci.capabilities.policy.spec import Policy, PolicySpec
from tci.errors import TciError
from tci.messages.frames import Array
from tci.support.installed import needs

KEY = "tci.policy"
"""Key of the description in the metadata of an ONNX file."""
TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}


class Network:
    """The network of a policy: from observations (history x k,) to actions (chunk x n,)."""

    def __init__(self, data: bytes, where: str) -> None:
        """`data` is the content of an ONNX file, `where` names it in errors."""
        self.data, self.where = data, where
        with needs(f"the policy {where}", "onnx"):
            import onnxruntime
        self._library = onnxruntime

    def __reduce__(self) -> tuple[Any, ...]:
        return Network, (self.data, self.where)

    @cached_property
    def _session(self) -> Any:
        options = self._library.SessionOptions()
        options.intra_op_num_threads = 1  # a small network is several times faster so
        options.log_severity_level = 3
        try:
            return self._library.InferenceSession(self.data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # it has its own for each fault
            raise TciError(
                f"{self.where} can't be loaded: {str(error).strip()}; valid: an ONNX model with its weights "
                "in the same file (torch.onnx.export(..., external_data=False))"
            ) from error

    @property
    def metadata(self) -> dict[str, str]:
        return dict(self._session.get_modelmeta().custom_metadata_map)

    @cached_property
    def _input(self) -> tuple[str, type, tuple[int, ...]]:
        inputs = self._session.get_inputs()
        if len(inputs) != 1 or inputs[0].type not in TYPES:
            found = ", ".join(f"{one.name}: {one.type}" for one in inputs)
            raise TciError(f"{self.where} has the inputs {found}; valid: one, of type float")
        sizes = [one if isinstance(one, int) else -1 for one in inputs[0].shape]
        if len(sizes) > 1 and sizes[0] == -1:
            sizes[0] = 1  # the batch
        if len(sizes) == 3 and sizes[1] == -1:
            raise TciError(f"{self.where}: its input has no fixed history; valid: (batch, history x values)")
        return inputs[0].name, TYPES[inputs[0].type], tuple(sizes)

    def __call__(self, seen: Array) -> Array:
        name, kind, shape = self._input
        try:
            found = self._session.run(None, {name: np.reshape(seen, shape).astype(kind)})[0]
        except Exception as error:
            raise TciError(f"{self.where} can't be computed for {len(seen)} values: {error}") from error
        return np.asarray(found, np.float64).ravel()


def read_policy(path: str | Path) -> tuple[Policy, PolicySpec]:
    """Reads a file of `write_policy`. Raises TciError if it is none, and MissingExtraError without
    onnxruntime."""
    path = Path(path)
    network = Network(_bytes(path), path.name)
    text = network.metadata.get(KEY)
    if text is None:
        raise TciError(
            f"{path} does not say what it sees and when it acts; valid: a file of "
            "tci.capabilities.policy.write_policy, or PolicyCapability(..., spec=PolicySpec(...))"
        )
    return network, PolicySpec.from_json(text, str(path))


def write_policy(path: str | Path, model: str | Path | bytes, spec: PolicySpec) -> None:
    """Writes an ONNX model, such as `torch.onnx.export` makes, with its description into one file.

    Raises TciError if the model can't be computed, gives another number of actions, or has a description
    already; if `spec` leaves out its scales (those of an environment are complete); or if the file can't be
    written.
    """
    data = model if isinstance(model, bytes) else _bytes(Path(model))
    network = Network(data, "model" if isinstance(model, bytes) else str(model))
    if KEY in network.metadata:
        raise TciError(f"{network.where} has a description already; valid: what the exporter wrote")
    if not (spec.scale and spec.action_scale):
        raise TciError(
            "policy: it has no scale; valid: the spec of an environment, or scale, action_scale ..."
        )
    check(network, spec)
    # A field that follows the others belongs to the same message, so no library of ONNX is needed.
    entry = _field(1, KEY.encode()) + _field(2, spec.to_json().encode())
    try:
        Path(path).write_bytes(data + _field(14, entry))
    except OSError as error:
        raise TciError(f"{path} can't be written: {error.strerror}") from None


def check(network: Network, spec: PolicySpec) -> None:
    """Raises TciError unless the network gives the actions of `spec` for what `spec` sees."""
    given = network(np.zeros(spec.history * len(spec.scale)))
    if given.size != spec.chunk * len(spec.joints):
        raise TciError(
            f"{network.where} gives {given.size} numbers; valid: {spec.chunk} actions of {len(spec.joints)} "
            f"joints ({', '.join(spec.joints)})"
        )


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise TciError(f"{path} can't be read: {error.strerror}") from None


def _field(number: int, data: bytes) -> bytes:
    """Bytes in a message of Protocol Buffers."""
    return _varint(number << 3 | 2) + _varint(len(data)) + data


def _varint(number: int) -> bytes:
    low = bytes([number & 0x7F | (0x80 if number > 0x7F else 0)])
    return low + _varint(number >> 7) if number > 0x7F else low

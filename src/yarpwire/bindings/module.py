"""Loading of YARP's module `yarp`, and conversion of Python objects for this module."""

from __future__ import annotations

import atexit
import importlib
import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from yarpwire.dialect import DIALECTS, Dialect
from yarpwire.errors import BindingsError, PortError, WireError
from yarpwire.names import PATIENCE, read_key
from yarpwire.values import FALSE, TRUE, Float32, Int8, Int16, Int64, Vocab

HOW = (
    "install it from conda (conda install -c conda-forge yarp-python), or build YARP with "
    "-DYARP_COMPILE_BINDINGS=ON -DCREATE_PYTHON=ON; PyPI's yarp is another package"
)
ADDERS: dict[type, str] = {
    int: "addInt32", float: "addFloat64", str: "addString", Vocab: "addVocab32",
    Int8: "addInt8", Int16: "addInt16", Int64: "addInt64", Float32: "addFloat32",
}  # fmt: skip
RESTED = 1.0
"""If a connection was idle for longer than this time [s], it is opened again, because the other end may have
closed it. Assumed: half of the 2 s after which YARP closes an idle connection."""
_open: dict[int, Any] = {}


def load() -> Any:
    """Imports the module `yarp`, and suppresses the messages with which YARP reports success. Raises
    BindingsError if the import fails; the error says how to install the module."""
    os.environ.setdefault("YARP_QUIET", "1")
    try:
        yarp = importlib.import_module("yarp")
    except (ImportError, OSError) as error:
        raise BindingsError(f"YARP's own module ({error})", HOW) from error
    if not hasattr(yarp, "NetworkBase"):
        raise BindingsError(f"YARP's own module ({yarp.__file__} is another yarp)", HOW)
    return yarp


def version(yarp: Any) -> tuple[str, Dialect]:
    """Returns the version of the bindings and their dialect. Raises PortError if the version is unknown."""
    dialect = DIALECTS.get(str(yarp.YARP_VERSION_MAJOR))
    if dialect is None:
        raise PortError(f"bindings of YARP {yarp.YARP_VERSION}; valid: {' and '.join(DIALECTS)}.x")
    return str(yarp.YARP_VERSION), dialect


def importable() -> str:
    """Returns version and dialect of the bindings as text; an empty text if the bindings can't be
    imported."""
    try:
        name, dialect = version(load())
    except (PortError, BindingsError):
        return ""
    return f"YARP's bindings {name}, dialect {dialect.name}"


def open_port(yarp: Any, port: Any, name: str) -> None:
    """Opens a port of YARP. Raises PortError if YARP refuses."""
    if not port.open(name):
        raise PortError(f"YARP does not open a port {name!r}; valid: a free name that begins with /")
    _open[id(port)] = port


def close_port(port: Any) -> None:
    """Closes a port. A second call does nothing."""
    if _open.pop(id(port), None) is not None:
        port.interrupt()
        port.close()


@atexit.register
def _close_all() -> None:
    """Closes all ports when the program ends, since YARP's threads must not call a Python interpreter that is
    ending."""
    for port in list(_open.values()):
        close_port(port)


def closes_at_rest() -> bool:
    """Returns True if authentication is on. Then ports close a connection after 2 s without data."""
    return read_key() is not None


def connect(yarp: Any, source: str, target: str, carrier: str) -> None:
    """Connects two ports, as `yarp connect` does. Raises PortError if that fails."""
    style = yarp.ContactStyle()
    style.quiet, style.timeout, style.carrier = True, PATIENCE, carrier
    if not yarp.NetworkBase.connect(source, target, style):
        raise PortError(f"{source} does not connect to {target} by {carrier}")


def to_bottle(yarp: Any, items: Sequence[Any], into: Any = None) -> Any:
    """Converts items to a Bottle of YARP. Raises WireError if a Bottle can't hold a value."""
    bottle = yarp.Bottle() if into is None else into
    for item in items:
        if isinstance(item, np.ndarray | np.generic):
            item = item.tolist()
        if isinstance(item, bool):
            item = TRUE if item else FALSE
        if isinstance(item, list | tuple):
            to_bottle(yarp, item, bottle.addList())
            continue
        name = ADDERS.get(type(item))
        if name is None:
            raise WireError(f"the yarp bindings can't put {item!r} into a Bottle")
        if name == "addInt32" and not -(1 << 31) <= item < 1 << 31:
            name = "addInt64"
        plain: type = next(kind for kind in (str, float, int) if isinstance(item, kind))
        getattr(bottle, name)(plain(item))
    return bottle


def reader(yarp: Any, read: Callable[[Any], bool]) -> Any:
    """Returns an object that YARP's threads call for each message. If `read` returns False, the connection
    ends."""

    class Reader(yarp.PortReader):  # type: ignore[misc] # SWIG's class has no types
        def read(self, connection: Any) -> bool:
            try:
                return read(connection)
            except Exception:  # the exception must not propagate through C++
                return False

    return Reader()

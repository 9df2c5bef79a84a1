"""The distribution (the installed package) that contains TCI, and installation advice for missing packages.

The advice uses the metadata of installed distributions, so this file contains no distribution name. The name
`tci` would be wrong: on PyPI it belongs to another package.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import (
    Distribution,
    PackageNotFoundError,
    distribution,
    entry_points,
    packages_distributions,
)
from typing import TYPE_CHECKING

from tci.errors import MissingExtraError

if TYPE_CHECKING:
    from packaging.requirements import Requirement

OWN = "tci.cli.main:main"
"""Value of the entry point `tci`. A distribution with this value is a distribution of TCI."""


def own_distribution() -> Distribution | None:
    """Returns the distribution that installed this package; None for a source folder without installation."""
    points = entry_points(group="console_scripts", name="tci")
    return next((point.dist for point in points if point.value == OWN), None)


def advice(extra: str, *, of: Distribution | None = None) -> str:
    """Returns advice on how to install the extra `extra` of the distribution `of`. The default of `of` is
    TCI's distribution.

    If the distribution has no such extra, the advice is to install the distribution itself.
    """
    found = of or own_distribution()
    if found is None:
        return "TCI itself is not installed: run pip install . in its folder"
    name = found.metadata["Name"]
    if extra not in (found.metadata.get_all("Provides-Extra") or ()):
        return f"install it with: pip install {name}"
    from packaging.requirements import Requirement  # every program imports this file, few need advice

    needs = [Requirement(text) for text in found.requires or ()]
    markers = [need.marker for need in needs if need.marker is not None and _names(need, extra)]
    if not any(marker.evaluate({"extra": extra}) for marker in markers):
        return f"it is not made for this machine; valid: {' or '.join(dict.fromkeys(map(str, markers)))}"
    return f"install it with: pip install '{name}[{extra}]'"


def installed_by(extra: str) -> dict[str, str]:
    """Returns, by name, the installed releases of the distributions that an extra of TCI requires.
    Distributions that are not installed are left out."""
    from packaging.requirements import Requirement

    found = own_distribution()
    needs = map(Requirement, (found.requires or ()) if found is not None else ())
    releases = {}
    for need in needs:
        if _names(need, extra):
            with suppress(PackageNotFoundError):
                releases[need.name] = distribution(need.name).version
    return releases


def _names(need: Requirement, extra: str) -> bool:
    """Returns True if a requirement belongs to an extra, even if the requirement does not apply to this
    machine."""
    return f'extra == "{extra}"' in str(need.marker)


@dataclass(frozen=True)
class Clash:
    """Installed distributions of different releases that overwrite each other's files in the folder of one
    module."""

    module: str
    said: str
    advice: str


CURES = {
    "tci": "pip uninstall {names}, then install again the one that you need",
    "mujoco": "pip install --force-reinstall --no-deps 'mujoco>=3.11,<4' serves TCI and what needs MuJoCo 3",
}
"""Advice for each module into whose folder two packages may write: TCI and another package `tci`, or
mujoco-core 4 and MuJoCo 3."""


def clashes() -> tuple[Clash, ...]:
    """Returns the clashes in this installation. A clash means that distributions of different releases write
    into the folder of one module. Only modules with a known clash are checked (`CURES`)."""
    return tuple(found for found in map(clash, CURES) if found is not None)


def clash(module: str) -> Clash | None:
    """Returns the clash of installed distributions that contain `module` and have different versions; None if
    there is no clash."""
    releases = {name: distribution(name).version for name in sorted(packages_distributions().get(module, ()))}
    if len(set(releases.values())) < 2:
        return None
    names = " and ".join(f"{name} {version}" for name, version in releases.items())
    said = f"{names} write into the same folder: the last one installed counts"
    return Clash(module, said, CURES[module].format(names=" ".join(releases)))


@contextmanager
def needs(what: str, extra: str, *, of: Distribution | None = None) -> Iterator[None]:
    """Context manager around imports: if a module is missing, raises MissingExtraError with installation
    advice."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = error.name or str(error)
        if missing.partition(".")[0] == "tci":
            raise
        raise MissingExtraError(what, missing, advice(extra, of=of)) from error

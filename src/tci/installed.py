"""The distribution that TCI was installed from, and what to install for a package that is missing.

Advice comes from the metadata of what is installed. No name is written down here: on PyPI `tci` is another
package.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import Distribution, distribution, entry_points, packages_distributions

from packaging.requirements import Requirement

from tci.errors import MissingExtraError

OWN = "tci.cli.main:main"
"""Value of the entry point that every distribution of TCI has."""


def own_distribution() -> Distribution | None:
    """Where this package is from; None for a source folder that was never installed."""
    points = entry_points(group="console_scripts", name="tci")
    return next((point.dist for point in points if point.value == OWN), None)


def advice(extra: str, *, of: Distribution | None = None) -> str:
    """Sentence that says how to get an extra `of` a distribution, else of TCI's own.

    Without an extra of that name, it says how to get what the distribution needs in any case.
    """
    found = of or own_distribution()
    if found is None:
        return "TCI itself is not installed: run pip install . in its folder"
    name = found.metadata["Name"]
    if extra not in (found.metadata.get_all("Provides-Extra") or ()):
        return f"install it with: pip install {name}"
    needs = [Requirement(text) for text in found.requires or ()]
    markers = [need.marker for need in needs if need.marker is not None and _names(need, extra)]
    if not any(marker.evaluate({"extra": extra}) for marker in markers):
        return f"it is not made for this machine; valid: {' or '.join(dict.fromkeys(map(str, markers)))}"
    return f"install it with: pip install '{name}[{extra}]'"


def _names(need: Requirement, extra: str) -> bool:
    """Whether a requirement belongs to an extra, on any machine."""
    return f'extra == "{extra}"' in str(need.marker)


@dataclass(frozen=True)
class Clash:
    """Distributions of different releases that install into the folder of one module."""

    module: str
    said: str
    advice: str


CURES = {
    "tci": "pip uninstall {names}, then install again the one that you need",
    "mujoco": "pip install --force-reinstall --no-deps 'mujoco>=3.11,<4' serves TCI and what needs MuJoCo 3",
}
"""Another's `tci` in the folder of TCI, MuJoCo 3 in that of mujoco-core 4, and what helps."""


def clashes() -> tuple[Clash, ...]:
    """Clashes that are known to happen, and are installed here."""
    return tuple(found for found in map(clash, CURES) if found is not None)


def clash(module: str) -> Clash | None:
    """Distributions of different releases that bring `module`; None where there is one release at most."""
    releases = {name: distribution(name).version for name in sorted(packages_distributions().get(module, ()))}
    if len(set(releases.values())) < 2:
        return None
    names = " and ".join(f"{name} {version}" for name, version in releases.items())
    said = f"{names} write into the same folder: the last one installed counts"
    return Clash(module, said, CURES[module].format(names=" ".join(releases)))


@contextmanager
def needs(what: str, extra: str, *, of: Distribution | None = None) -> Iterator[None]:
    """Guards imports: a module that is not there becomes a MissingExtraError with its advice."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = error.name or str(error)
        if missing.partition(".")[0] == "tci":
            raise
        raise MissingExtraError(what, missing, advice(extra, of=of)) from error

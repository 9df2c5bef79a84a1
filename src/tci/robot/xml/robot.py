"""Reader of robot descriptions in XML: Listing 2 of the paper and its extensions
(docs/robot-description.md)."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from lxml import etree

from tci.errors import MissingExtraError
from tci.robot.description import Address, Binding, Patch, Robot
from tci.robot.xml.document import Faults, refuse
from tci.robot.xml.extends import read_element
from tci.robot.xml.grammar import GENERIC_ROBOT
from tci.robot.xml.initial import check_retargeted, initial_angles
from tci.robot.xml.model import read_model
from tci.robot.xml.node import Node, nearest, read_node
from tci.robot.xml.parts import read_parts
from tci.robot.xml.servos import Servos, once_only, read_couplings, read_servos
from tci.robot.xml.skin import read_skin
from tci.support.installed import advice

SHARE = 0.25
"""If more than this fraction of the angles in a file is implausible, one fault is reported: the unit of the
file is wrong. If fewer angles are implausible, each of them is reported as wrong. Assumed: even in a wrong
unit many angles are plausible, because they are small."""


def read_robot(path: str | os.PathLike[str]) -> Robot:
    """Reads the description of a robot from the file at `path`, and converts it to SI units and radians.

    - Raises DescriptionError with all faults of the file, each with its line and the valid values.
    - Raises DescriptionError if a retargeted shoulder does not fit the kinematic model.
    - Raises MissingExtraError if the file is valid, but the model is in a package that is not installed.
    """
    file = Path(path)
    element, data = read_element(file)
    root, faults = _read_root(element, str(file))
    servos = read_servos(root, faults)
    parts = read_parts(root, servos, faults)
    couplings = read_couplings(root, servos, initial_angles(parts), faults)
    model, missing = read_model(root, file, faults)
    patches = read_skin(root, file, faults)
    bindings = _bindings(root, servos, patches, faults)
    faults.check()
    name = root.get("name") or file.stem
    if missing is not None:
        node = root.first("model")
        extra = node.get("extra") if node is not None else None
        if extra is None:
            line = node.line if node is not None else 0
            raise refuse(
                str(file),
                line,
                f"the package {missing!r} is not installed; install it with: pip install {missing}",
            )
        raise MissingExtraError(f"the kinematic model of {name}", missing, advice(extra))
    robot = Robot(
        name=name, title=root.get("title", ""), source=str(file.absolute()),
        digest=hashlib.sha256(data).hexdigest(), model=model, servos=tuple(servos.all),
        couplings=couplings, parts=parts, patches=patches, bindings=bindings,
    )  # fmt: skip
    check_retargeted(root, robot, faults)
    faults.check()
    return robot


def _read_root(element: etree._Element, source: str) -> tuple[Node, Faults]:
    """Reads all elements of a description. Returns the root element and the faults of all elements. If many
    angles are implausible because the unit of the file is wrong, they are reported as one fault.

    A file without a unit has a fault. Its angles are still checked, as if the unit were degrees.
    """
    unit = element.get("angle_unit")
    faults, others = Faults(source), Faults(source)
    root = read_node(element, GENERIC_ROBOT, "rad" if unit == "rad" else "deg", faults)
    single = faults.implausible == 1 < faults.angles
    if unit != "rad" or single or faults.implausible <= SHARE * faults.angles:
        return root, faults
    root = read_node(element, GENERIC_ROBOT, "deg", others)
    wrong = f"{faults.implausible} of {faults.angles} angles are implausible"
    message = f"angle_unit of <{element.tag}> is 'rad', in which {wrong}; valid: angle_unit=\"deg\""
    others.add(element.sourceline or 0, message)
    return root, others


VALUES, TAXELS = 12, 10
"""Number of values per module of skin, and number of taxels among these values."""


def schema_path() -> Path:
    """Returns the path of the XSD schema of descriptions, for editors. `read_robot` checks more than this
    schema can express."""
    return Path(__file__).with_name("robot.xsd")


IMU = "imu"
"""Name in an address for the sensor of acceleration of the robot's root link."""


def _bindings(root: Node, servos: Servos, patches: Sequence[Patch], faults: Faults) -> tuple[Binding, ...]:
    """Reads the bindings: rates and addresses for each middleware. Does not check the modules in an address
    if the description of its patch has faults."""
    skin = root.first("skin")
    names = [patch.get("name") for patch in skin.all("patch")] if skin is not None else []
    known = {name for servo in servos.all for name in (servo.name, servo.robot_part)}
    known |= {name for name in names if name is not None}
    known.add(IMU)
    channels = {patch.name: patch.channels for patch in patches}
    faulty = {*names} - channels.keys()
    bindings = []
    for node in once_only(root.all("binding"), "middleware", "binding with", faults):
        if not node.ok:
            continue
        rate, stale_after = node.get("rate"), node.get("stale_after")
        if stale_after * rate < 1.0:
            faults.add(
                node.line,
                f"stale_after {stale_after:g} s is shorter than the {1.0 / rate:g} s between two commands: "
                "all data would be too old",
            )
        addresses = []
        for place in once_only(node.all("address"), "of", "address of", faults):
            name = place.get("of")
            if name not in known:
                if None not in faulty:
                    near = nearest(name, sorted(known))
                    faults.add(place.line, f"no patch, robot part or servo {name!r}{near}")
                continue
            addresses.append(Address(**place.fields))
            if name not in faulty:
                _check_modules(place, addresses[-1], channels, faults)
        sources = [one for one in once_only(node.all("source"), "via", "source with", faults) if one.ok]
        if sources and node.get("middleware") == "sim":
            words = "a source in the binding of sim: a simulation must run without it; valid: --via"
            faults.add(sources[0].line, f"{words} 'sim + {sources[0].get('via')}'")
        via = tuple(one.get("via") for one in sources)
        bindings.append(Binding(**node.fields, addresses=tuple(addresses), sources=via))
    return tuple(bindings)


def _check_modules(node: Node, address: Address, channels: Mapping[str, int], faults: Faults) -> None:
    """Checks the skin modules in a patch's address; a module has 10 taxels and takes 12 values in a message.
    Records a fault if the number of taxels is not the number of the patch's channels, or if the message is
    too short for the modules."""
    if address.channels is None and not address.modules:
        return
    own, wide = channels.get(address.of, 0), address.channels or 0
    taxels = TAXELS * len(address.modules)
    if taxels != own or any(VALUES * (module + 1) > wide for module in address.modules):
        faults.add(
            node.line,
            f"address of {address.of!r}: {len(address.modules)} modules of {TAXELS} in {wide} channels; "
            f"valid: for a patch, as many taxels as its {own} channels; modules 0 to {wide // VALUES - 1}",
        )

"""A description that uses most of the dialect, and damage to it."""

from __future__ import annotations

import random

GOOD = """<?xml version="1.0"?>
<generic_robot version="1" name="tester" angle_unit="deg">
  <robot_part name="LArm">
    <servo id="0" name="pitch"><position min="-90" max="90"/><velocity max="200"/></servo>
    <servo id="1" name="roll"><position min="-20" max="80"/><jerk max="9000" origin="assumed"/></servo>
  </robot_part>
  <robot_part name="Neck"><servo id="0" name="neck"/></robot_part>
  <coupling name="cable" min="-100" max="100">
    <term robot_part="LArm" servo="0" coefficient="1"/><term robot_part="LArm" servo="1" coefficient="-1"/>
  </coupling>
  <generic_robot_part name="head" robot_part="LArm">
    <generic_servo_number>3</generic_servo_number>
    <generic_servo id="0" name="a">
      <destination_servo_id>1</destination_servo_id>
      <transform_factor>-2</transform_factor>
      <transform_displacement>90</transform_displacement>
      <stiffness>0.5</stiffness><damping>0.1</damping><speed>20</speed>
    </generic_servo>
    <generic_servo id="1" name="b">
      <destination_servo_id robot_part="Neck">0</destination_servo_id>
    </generic_servo>
    <generic_servo id="2" name="c">
      <destination_servo_id>none</destination_servo_id>
      <fixed_position>12</fixed_position>
    </generic_servo>
    <initial_positions>
      <servo type="rad" destination_servo_id="0" pos="1.0"/>
      <servo destination_servo_id="1" pos="0"/>
    </initial_positions>
  </generic_robot_part>
  <binding middleware="sim" rate="100" stale_after="0.1"/>
  <binding middleware="other" rate="50" stale_after="0.1"><address of="Neck" to="/neck"/></binding>
</generic_robot>
"""


def damage(data: bytes, chance: random.Random) -> bytes:
    """Returns the data after one to four random edits: a changed byte, or a piece that is cut, doubled or
    moved."""
    pieces = [b"nan", b"-1", b"1e999", b"<", b"&x;", b'"', b"\xff"]
    for _ in range(chance.randint(1, 4)):
        if not data:
            break
        start = chance.randrange(len(data))
        end = min(len(data), start + chance.choice([1, 1, 3, 20, 200]))
        data = chance.choice(
            [
                data[:start] + bytes([chance.randrange(256)]) + data[start + 1 :],
                data[:start] + data[end:],
                data[:end] + data[start:],
                data[:start] + chance.choice(pieces) + data[end:],
            ]
        )
    return data

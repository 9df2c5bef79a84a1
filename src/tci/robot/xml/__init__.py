"""Robot descriptions in XML: the paper's Listing 2 and its extensions (docs/robot-description.md)."""

from tci.robot.xml.robot import read_robot, schema_path

__all__ = ["read_robot", "schema_path"]

"""Robot descriptions in XML: Listing 2 of the paper and its extensions (docs/robot-description.md)."""

from tci.robot.xml.robot import read_robot, schema_path

__all__ = ["read_robot", "schema_path"]

"""The description of the package, as PyPI shows it: README.md without links into the sources.

They would lead nowhere there. Once the sources have an address, give it as `base` in pyproject.toml
(`https://HOST/PROJECT/blob/main/`), and they become links again.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

IMAGE, LINK = r"!\[([^]]*)\]\((?!\w+:)[^)]*\)\n*", r"\[([^]]*)\]\((?!\w+:)([^)]*)\)"
"""An image and a link whose address is a path."""
WHERE = "\nThe pages that this text names are in the folder `docs` of the source distribution.\n"


def described(readme: str, base: str) -> str:
    if base:
        return re.sub(LINK, rf"[\1]({base}\2)", readme)
    return re.sub(LINK, r"\1", re.sub(IMAGE, "", readme)) + WHERE


class Description(MetadataHookInterface):
    def update(self, metadata: dict[str, Any]) -> None:
        text = described(
            Path(self.root, "README.md").read_text(encoding="utf-8"), self.config.get("base", "")
        )
        metadata["readme"] = {"content-type": "text/markdown", "text": text}

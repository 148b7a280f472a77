"""Public repositories whose pictures are used here. None of the pictures is part of this one.

Each is a folder OWNER+NAME, a checkout of the repository OWNER/NAME on GitHub at the commit given:

    git clone https://github.com/OWNER/NAME OWNER+NAME && git -C OWNER+NAME checkout COMMIT
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mrs_people_loc.errors import BagError


@dataclass(frozen=True)
class Source:
    """A public repository.

    Attributes:
        repository: Its owner and name on GitHub.
        commit: The commit that was used.
        licence: As stated there.
        what: What of it is used.
    """

    repository: str
    commit: str
    licence: str
    what: str

    def within(self, folder: Path) -> Path:
        """Its checkout.

        Args:
            folder: Holds the checkouts of all sources.

        Raises:
            BagError: It is not there.
        """
        path = folder / self.repository.replace("/", "+")
        if not path.is_dir():
            raise BagError(
                f"{path} is missing; wanted: https://github.com/{self.repository} at {self.commit}"
            )
        return path

# SPDX-License-Identifier: Apache-2.0
"""The restraint region as it is clicked together, and the SPECs that say the same."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Bools, TriangleGeometry
from vega_planner.errors import BadRestraint, OutputError
from vega_planner.part.restraint import choose_restraint
from vega_planner.settings import PartSettings
from vega_planner.viewer.picking import Hit


@dataclass(frozen=True, eq=False)
class _Pick:
    """One SPEC and the faces it selects, shape (m,)."""

    spec: str
    faces: Bools


class RestraintPicks:
    """A union of SPECs and of single faces.

    Clicking on what is chosen takes it away again.
    """

    def __init__(
        self,
        mesh: TriangleGeometry,
        settings: PartSettings,
        faces_file: Path,
        specs: tuple[str, ...] = (),
        chosen: Bools | None = None,
    ) -> None:
        """Start with the region of a part.

        Args:
            mesh: The part.
            settings: For the angles of smooth regions.
            faces_file: File that single faces are written to.
            specs: SPECs of the region at the start.
            chosen: The faces they select, shape (m,); worked out when absent.

        Raises:
            BadRestraint: If a SPEC is no good.
        """
        self._mesh = mesh
        self.settings = settings
        self.faces_file = faces_file
        self._picks: list[_Pick] = []
        self._single = np.zeros(len(mesh.faces), dtype=bool)
        specs = tuple(spec for spec in specs if spec != "none")
        if chosen is not None and specs:
            self._picks = [_Pick(" ".join(specs), chosen)] if len(specs) == 1 else []
        if specs and not self._picks:
            self.set_specs(specs)

    @property
    def faces(self) -> Bools:
        """True for the chosen faces, shape (m,)."""
        chosen = self._single.copy()
        for pick in self._picks:
            chosen |= pick.faces
        return chosen

    @property
    def specs(self) -> tuple[str, ...]:
        """SPECs whose union is the region; `("none",)` for an empty one."""
        specs = [pick.spec for pick in self._picks]
        if self._single.any():
            specs.append(f"faces:{self.faces_file}")
        return tuple(specs) or ("none",)

    def set_specs(self, specs: tuple[str, ...]) -> None:
        """Replace the region by a union of SPECs.

        Raises:
            BadRestraint: If a SPEC is no good; the region is then as it was.
        """
        specs = tuple(spec.strip() for spec in specs if spec.strip() not in ("", "none"))
        picks = [_Pick(spec, self._select(spec)) for spec in specs]
        if picks and np.any([pick.faces for pick in picks], axis=0).all():
            raise BadRestraint(
                f"restraint {' '.join(specs)} selects the whole surface; at least one face "
                "must stay free to be enveloped"
            )
        self._picks = picks
        self._single[:] = False

    def clear(self) -> None:
        """Choose nothing."""
        self.set_specs(())

    def toggle_region(self, hit: Hit) -> str:
        """Add the smooth region round a face, or take away the picks that hold it.

        Returns:
            What was done, for a person.

        Raises:
            BadRestraint: If nothing would be left to envelop.
        """
        if self.faces[hit.face]:
            return self._take_away(hit.face)
        pick = self._region(hit)
        self._refuse_everything(pick.faces)
        self._picks.append(pick)
        return f"added {pick.spec}, {int(pick.faces.sum())} faces"

    def toggle_face(self, hit: Hit) -> str:
        """Add or take away a single face, and write the file of single faces.

        Returns:
            What was done, for a person.

        Raises:
            BadRestraint: If nothing would be left to envelop.
            OutputError: If the file cannot be written.
        """
        if self.faces[hit.face]:
            return self._take_away(hit.face)
        one = np.zeros(len(self._mesh.faces), dtype=bool)
        one[hit.face] = True
        self._refuse_everything(one)
        self._single[hit.face] = True
        self._write_single()
        return f"added face {hit.face}"

    def _take_away(self, face: int) -> str:
        before = len(self._picks)
        self._picks = [pick for pick in self._picks if not pick.faces[face]]
        if self._single[face]:
            self._single[face] = False
            self._write_single()
            return f"took face {face} away"
        return f"took {before - len(self._picks)} pick(s) away"

    def _region(self, hit: Hit) -> _Pick:
        """The shortest point SPEC that selects the region of the face that was hit."""
        middle = self._mesh.vertices[self._mesh.faces[hit.face]].mean(0)
        for point, digits in ((hit.point, 3), (middle, 4), (middle, 7)):
            spec = "point:" + ",".join(_short(value, digits) for value in point)
            faces = self._select(spec)
            if faces[hit.face]:
                break
        return _Pick(spec, faces)

    def _select(self, spec: str) -> Bools:
        return choose_restraint(self._mesh, (spec,), self.settings)[0]

    def _refuse_everything(self, more: Bools) -> None:
        if (self.faces | more).all():
            raise BadRestraint("this would restrain the whole surface; nothing could be enveloped")

    def _write_single(self) -> None:
        numbers = " ".join(map(str, np.flatnonzero(self._single)))
        text = f"# faces of part.ply\n{numbers}\n"
        try:
            self.faces_file.parent.mkdir(parents=True, exist_ok=True)
            self.faces_file.write_text(text, encoding="utf-8")
        except OSError as error:
            raise OutputError(f"{self.faces_file} cannot be written: {error.strerror}") from error


def _short(value: float, digits: int) -> str:
    """A number without trailing zeros, and without a minus before nothing."""
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0", "-") else text

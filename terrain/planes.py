"""Base planes: height maps that stand anywhere in the world, beside the terrain.

A terrain is a base plane that lies level at the origin; a wall, a slab or an overhang is the same thing, placed. Only
the ray caster of perturbed base planes (`terrain.algorithms.perturbation`) can draw those; the other algorithms draw
the terrain alone.

**Source**: S. I. Vyatkin, S. V. Pavlov, S. A. Romanyuk, "Real-time hybrid terrain rendering", sections 2 and 3.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from terrain.heightfield import Heightfield

Floats = npt.NDArray[np.float64]

# The paper's T (equation 9): the plane's axes (x along columns, y along the normal, z along rows) to (u, v, h).
_UVH_FROM_XYZ = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], np.float64)


@dataclass(frozen=True, eq=False)
class BasePlane:
    """A plane with a rectangular contour, and the height map that perturbs it along its normal.

    Attributes
    ----------
    heightfield : Heightfield
        The perturbation; its axes are the plane's: x along columns, y the normal, z along rows, from post (0, 0).
    world_from_plane : ndarray of float64, (4, 4)
        Where the plane stands: an affine map of the plane's metres to world metres.
    colour : tuple of 3 float
        Its albedo, display colours 0..1.

    Raises
    ------
    ValueError
        If the map is not affine and invertible.
    """

    heightfield: Heightfield
    world_from_plane: Floats = field(default_factory=lambda: np.eye(4))
    colour: tuple[float, float, float] = (0.62, 0.56, 0.48)

    def __post_init__(self) -> None:
        m = self.world_from_plane
        if m.shape != (4, 4) or not np.isfinite(m).all() or not np.array_equal(m[3], [0, 0, 0, 1]):
            raise ValueError(f"expected an affine map (4, 4), found {m!r}")
        if abs(np.linalg.det(m)) < 1e-12 * max(np.abs(m[:3, :3]).max(), 1e-300) ** 3:
            raise ValueError(f"expected an invertible map, found {m!r}")

    @property
    def map_from_world(self) -> Floats:
        """G = T M (equation 10): world metres to (u, v, h), columns, rows and metres along the normal."""
        dx, dz = self.heightfield.spacing_m
        posts = np.diag([1.0 / dx, 1.0 / dz, 1.0, 1.0])
        return posts @ _UVH_FROM_XYZ @ np.linalg.inv(self.world_from_plane)

    def corners_m(self, range_m: tuple[float, float]) -> Floats:
        """The eight corners (8, 3) of the box over the contour between two heights, world metres."""
        width, depth = self.heightfield.extent_m
        corners = np.array(np.meshgrid([0.0, width], range_m, [0.0, depth], indexing="ij")).reshape(3, 8)
        return (self.world_from_plane[:3, :3] @ corners + self.world_from_plane[:3, 3:]).T


def place_plane(
    origin_m: tuple[float, float, float], yaw_deg: float = 0.0, tilt_deg: float = 0.0, roll_deg: float = 0.0
) -> Floats:
    """A ``world_from_plane``: rolled about its rows' axis, tilted about its columns' axis, turned clockwise, moved."""
    yaw, tilt, roll = np.radians([-yaw_deg, tilt_deg, roll_deg])
    about_y = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    about_z = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    placed = np.eye(4)
    placed[:3, :3] = about_y @ about_x @ about_z
    placed[:3, 3] = origin_m
    return placed

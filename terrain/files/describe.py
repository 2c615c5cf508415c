"""What a terrain is, in figures: the answer of ``reliefscope info``, as a dictionary and as text."""

from __future__ import annotations

from typing import Any

from terrain.heightfield import Heightfield


def describe(heightfield: Heightfield) -> dict[str, Any]:
    """Figures of a terrain, ready for JSON.

    Returns
    -------
    dict
        ``name``, ``rows``, ``cols``, ``spacing_m`` ([x, z]), ``height_m`` ([min, max], true heights of posts with
        data), ``crs`` (or None), ``units`` (of the heights, after conversion), ``nodata_share`` (0 to 1) and ``notes``.
    """
    low, high = (height / heightfield.exaggeration for height in heightfield.height_range_m)
    holes, georeference = heightfield.holes, heightfield.georeference
    return {
        "name": heightfield.name,
        "rows": heightfield.rows,
        "cols": heightfield.cols,
        "spacing_m": list(heightfield.spacing_m),
        "height_m": [min(low, high), max(low, high)],
        "crs": georeference.crs if georeference else None,
        "units": "m",
        "nodata_share": 0.0 if holes is None else float(holes.mean()),
        "notes": list(heightfield.notes),
    }


def describe_text(heightfield: Heightfield) -> str:
    """The same for people: one line per figure, then one per note."""
    facts = describe(heightfield)
    (dx, dz), (low, high), (width, depth) = facts["spacing_m"], facts["height_m"], heightfield.extent_m
    share, crs = facts["nodata_share"], facts["crs"] or "unknown"
    if "[" in crs:  # WKT begins with its kind and a name: KIND["name", and goes on
        crs = '"'.join(crs.split('"')[:2]) + '" ...]'
    lines = [
        f"{facts['name']}: {facts['cols']} x {facts['rows']} posts, {dx:.6g} x {dz:.6g} m apart "
        f"({width / 1000:.4g} x {depth / 1000:.4g} km)",
        f"heights {low:.6g} to {high:.6g} m" + (f", no data at {100 * share:.3g} % of the posts" if share else ""),
        f"coordinate system {crs}",
        *(f"- {note}" for note in facts["notes"]),
    ]
    return "\n".join(lines)

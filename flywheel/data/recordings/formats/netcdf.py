"""netCDF 4: HDF5 with packed numbers, fill values, and variables that share their rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flywheel.data.recordings.formats.arrays import check_size
from flywheel.records import Floats

MADE_BY = "_NCProperties"  # attribute of the file
NO_VARIABLE = "This is a netCDF dimension but not a netCDF variable"
SECONDS = {
    "days": 86400.0,
    "hours": 3600.0,
    "minutes": 60.0,
    "seconds": 1.0,
    "milliseconds": 1e-3,
    "microseconds": 1e-6,
    "nanoseconds": 1e-9,
}


def is_variable(each: Any) -> bool:
    """False for a data set that only stands for a dimension."""
    return not _text(each.attrs.get("NAME", "")).startswith(NO_VARIABLE)


def numbers(each: Any) -> Floats:
    """The numbers of a variable: NaN where none was written, unpacked, and dates in seconds."""
    from h5py import h5d  # an extra

    values, attributes = np.asarray(each[()]), each.attrs
    missing = [np.ravel(attributes.get("missing_value", []))]
    if each.id.get_create_plist().fill_value_defined() == h5d.FILL_VALUE_USER_DEFINED:
        missing.append(np.ravel(each.fillvalue))
    unpacked = np.where(np.isin(values, np.concatenate(missing)), np.nan, values)
    for name, change in (("scale_factor", np.multiply), ("add_offset", np.add)):
        if name in attributes:
            unpacked = change(unpacked, float(np.ravel(attributes[name])[0]))
    unit, since, _ = _text(attributes.get("units", "")).partition(" since ")
    return np.asarray(unpacked * (SECONDS.get(unit, 1.0) if since else 1.0), np.float64)


def dimension(each: Any) -> str:
    """Path of the data set that stands for a variable's first dimension; empty without one."""
    scales = [each] if each.is_scale else each.dims[0].values() if each.ndim else []
    return str(scales[0].name) if scales and each.ndim else ""


def padded(found: Mapping[str, Any], along: Mapping[str, str]) -> dict[str, Any]:
    """Arrays of which those along one dimension have equally many rows: NaN where none was written.

    Args:
      found: arrays by name.
      along: dimensions of netCDF variables by name, empty for those without one.

    Raises:
      DataError: they would be too large.
    """
    rows: dict[str, int] = {}
    for name, place in along.items():
        if place:
            rows[place] = max(rows.get(place, 0), len(found[name]))
    short = {name: rows[place] - len(found[name]) for name, place in along.items() if place}
    more = sum(count * int(np.prod(found[name].shape[1:])) for name, count in short.items())
    check_size(more + sum(each.size for each in found.values()), "the file")
    return dict(found) | {
        name: np.concatenate([found[name], np.full((count, *found[name].shape[1:]), np.nan)])
        for name, count in short.items()
    }


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)

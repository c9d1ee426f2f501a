"""HDF5 files, and MATLAB's of version 7.3, which are such."""

from __future__ import annotations

import posixpath
from pathlib import Path
from typing import Any

import numpy as np

from flywheel.data.recordings.formats import netcdf
from flywheel.data.recordings.formats.arrays import check_size, streams
from flywheel.data.recordings.formats.stream import Contents
from flywheel.errors import ConfigError, DataError

MOST_LINKS = 10  # to links, one after the other


def read(path: Path, names: tuple[str, ...]) -> Contents:
    """See `Reader`. Data sets are named by their paths; links to other files are not followed."""
    try:
        import h5py  # an extra
    except ImportError:
        raise ConfigError("HDF5 needs h5py: install flywheel[formats].") from None
    found: dict[str, Any] = {}
    notes: list[str] = []
    along = dict[str, str]()  # of netCDF: the dimension of an array
    with path.open("rb") as file:
        matlab = file.read(6) == b"MATLAB"
    try:
        with h5py.File(path, "r") as opened:
            packed = netcdf.MADE_BY in opened.attrs
            for name, each in _data_sets(opened).items():
                if not _has_numbers(each):
                    notes.append(f"{name!r} is left out: it has no numbers of its own")
                    continue
                check_size(each.size or 0, name)
                check_size(sum(a.size for a in found.values()), "the file")
                called = name.replace("/", ".") if matlab else name
                if packed and each.dtype.kind in "iuf":
                    found[called], along[called] = netcdf.numbers(each), netcdf.dimension(each)
                else:
                    found |= _columns(called, each, matlab)
                if each.scaleoffset is not None and each.dtype.kind == "f":
                    notes.append(
                        f"{called!r} was saved with scaleoffset, which makes numbers of NaN: the "
                        "smallest of its chunk"
                    )
            found = netcdf.padded(found, along)
    except DataError:
        raise
    except Exception as error:  # h5py raises whatever a damaged file leads to
        raise DataError(f"it is damaged: {str(error).splitlines()[:1]}.") from None
    return streams(found, tuple(notes))


def _has_numbers(each: Any) -> bool:
    if each.is_virtual or each.external or "MATLAB_empty" in each.attrs:
        return False
    return bool(each.dtype.names or each.dtype.kind in "biuf") and netcdf.is_variable(each)


def _columns(name: str, each: Any, turned: bool) -> dict[str, Any]:
    """The array of a data set, or one for each field that is a number; MATLAB turned it."""
    values = np.asarray(each[()])
    if values.dtype.names:
        numbers = [f for f in values.dtype.names if values.dtype[f].kind in "biuf"]
        return {f"{name}.{f}": np.asarray(values[f]) for f in numbers}
    return {name: values.T if turned else values}


def _data_sets(file: Any) -> dict[str, Any]:
    """Data sets by each of their paths: `visititems` names them once, and leaves out soft links."""
    import h5py  # an extra

    found, links = dict[str, Any](), dict[str, str]()

    def visit(name: str, group: Any) -> None:
        if not isinstance(group, h5py.Group) or name.startswith("#"):
            return
        for key in group:
            path, link = posixpath.join(name, key), group.get(key, getlink=True)
            if isinstance(link, h5py.SoftLink):
                links[path] = posixpath.join(name, link.path).lstrip("/")
            elif isinstance(link, h5py.HardLink) and isinstance(group[key], h5py.Dataset):
                found[path] = group[key]

    visit("", file)
    file.visititems(visit)
    for path, target in links.items():
        for _ in range(MOST_LINKS):
            target = links.get(target, target)
        there = [name for name in found if f"{name}/".startswith(f"{target}/")]
        found |= {path + name[len(target) :]: found[name] for name in there}
    return found

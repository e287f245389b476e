"""NamedTuples to HDF5 groups and back: field → dataset, its `Quantity` → units, axes and `<name>_errors`."""

from __future__ import annotations

import importlib
import json
import re
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import h5py
import numpy as np

from whid.kinds import plain
from whid.quantity import Quantity
from whid.system import System

NO_COORDINATE = "This is a netCDF dimension but not a netCDF variable. %10d"  # what netCDF readers look for
PACKED = 1 << 12  # samples from which a dataset is chunked and compressed
Units = Mapping[str, str]  # what "input" and "output" stand for


def units(text: str, of: Units) -> str:
    """Return a unit with `input` and `output` replaced by the record's own, put in brackets where they need it.

    >>> units("output/input", {"input": "V", "output": "m/s"})
    '(m/s)/V'
    >>> units("output/input", {"input": "1", "output": "V"}), units("output", {"input": "1", "output": "m/s"})
    ('V', 'm/s')
    """

    def replaced(match: re.Match[str]) -> str:
        unit = of.get(match[0], match[0])
        return f"({unit})" if re.search(r"[/* ·]", unit) and match[0] != text else unit

    return re.sub(r"(?<=.)/1$", "", re.sub(r"(?<![A-Za-z_])(input|output)(?![A-Za-z_])", replaced, text))


def write(parent: h5py.Group, name: str, value: Any, of: Units) -> h5py.Group:
    """Write a NamedTuple as a group: one dataset a field, a dimension scale on every axis, NeXus' signal and axes."""
    group = parent.create_group(name)
    kind = type(value)
    group.attrs["type"] = f"{kind.__module__}:{kind.__qualname__}"
    group.attrs["title"] = (kind.__doc__ or name).strip().partition("\n")[0]
    quantities = _quantities(kind)
    error_of = {q.error: field for field, q in quantities.items() if q.error}
    for field in value._fields:
        label = f"{error_of[field]}_errors" if field in error_of else field
        put(group, label, getattr(value, field), units(quantities[field].units, of), of, field)
    axes = {dim for quantity in quantities.values() for dim in quantity.dims}
    for field, quantity in quantities.items():
        label = f"{error_of[field]}_errors" if field in error_of else field
        attach(group, label, quantity.dims or ((field,) if field in axes else ()))
    _nexus(group, quantities)
    return group


def put(group: h5py.Group, name: str, value: Any, unit: str, of: Units, field: str = "") -> None:
    """Write one value under a name, in the form that `get` turns back into the same Python value."""
    if value is None:
        return  # an absent field reads as None
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        write(group, name, value, of)
    elif isinstance(value, (tuple, list)) and value and all(hasattr(item, "_fields") for item in value):
        inner = group.create_group(name)
        inner.attrs["type"], inner.attrs["NX_class"] = "sequence", "NXcollection"
        for k, item in enumerate(value, 1):
            write(inner, str(k), item, of)
    else:
        data, python = _encoded(value)
        dataset = array(group, name, data, unit)
        dataset.attrs["python"] = python
        if field and field != name:
            dataset.attrs["field"] = field
    if field and isinstance(group[name], h5py.Group) and field != name:
        group[name].attrs["field"] = field


def array(group: h5py.Group, name: str, data: Any, unit: str) -> h5py.Dataset:
    """Write an array: numbers with units, text as UTF-8, truth values as xarray writes them."""
    values = np.asarray(data)
    if values.dtype.kind in "UO":
        return group.create_dataset(name, data=np.asarray(data, object), dtype=h5py.string_dtype())
    options: dict[str, Any] = {}
    if values.size >= PACKED:
        options = {"chunks": True, "compression": "gzip", "compression_opts": 1, "shuffle": True}
    stored = values.view(np.int8) if values.dtype.kind == "b" else values
    dataset = group.create_dataset(name, data=stored, **options)
    if values.dtype.kind == "b":
        dataset.attrs["dtype"] = "bool"
    else:
        dataset.attrs["units"] = unit
    return dataset


def get(item: h5py.Group | h5py.Dataset, tree: Callable[[Any], System]) -> Any:
    """Read back what `put` wrote; `tree` makes a System of its plain mapping."""
    if isinstance(item, h5py.Group):
        if item.attrs["type"] == "sequence":
            return tuple(get(item[str(k)], tree) for k in range(1, len(item) + 1))
        return _rebuilt(str(item.attrs["type"]), fields(item, tree))
    python = item.attrs["python"]
    if python in ("json", "system"):
        value = json.loads(item.asstr()[()])
        return tree(value) if python == "system" else value
    if h5py.check_string_dtype(item.dtype):
        return item.asstr()[()] if python == "str" else tuple(item.asstr()[:])
    value = item[()].astype(bool) if item.attrs.get("dtype") == "bool" else item[()]
    return {"array": lambda: value, "tuple": lambda: tuple(np.asarray(value).tolist())}.get(python, value.item)()


def fields(group: h5py.Group, tree: Callable[[Any], System]) -> dict[str, Any]:
    """Read every value of a group by field; axes that are only an index are left out."""
    return {str(item.attrs.get("field", name)): get(item, tree) for name, item in group.items() if _is_value(item)}


def _encoded(value: Any) -> tuple[Any, str]:
    """Return what is stored and the name of the Python type to return to."""
    if isinstance(value, System):
        return json.dumps(plain(value), default=_other), "system"
    if isinstance(value, str):
        return value, "str"
    if isinstance(value, (bool, int, float, complex, np.generic)):
        return value, type(value).__name__
    if isinstance(value, (tuple, list)) and not value:
        return np.empty(0, object), "tuple"
    try:
        data = np.asarray(value)
    except ValueError:  # ragged
        data = np.empty(0, object)
    if data.dtype.kind == "O" or isinstance(value, dict):
        return json.dumps(plain(value), default=_other), "json"
    return data, "array" if isinstance(value, np.ndarray) else "tuple"


def _other(value: Any) -> Any:
    """Return what JSON has no word for: arrays as lists, complex numbers as configs write them, anything else as text."""
    return value.tolist() if hasattr(value, "tolist") else str(value).strip("()")


def _is_value(item: h5py.Group | h5py.Dataset) -> bool:
    return "python" in item.attrs if isinstance(item, h5py.Dataset) else "type" in item.attrs


def _rebuilt(type_name: str, fields: dict[str, Any]) -> Any:
    """Return the whid NamedTuple that was written, or a namespace where the class is gone, changed or a stranger's."""
    module, _, name = type_name.partition(":")
    if module.startswith("whid."):
        try:
            kind = getattr(importlib.import_module(module), name, None)
        except ImportError:
            kind = None
        if hasattr(kind, "_fields") and set(fields) <= set(kind._fields):  # type: ignore[union-attr]
            return kind(**({field: None for field in kind._fields} | fields))  # type: ignore[union-attr, misc]
    return SimpleNamespace(**fields)


def _quantities(kind: type) -> dict[str, Quantity]:
    hints = get_type_hints(kind, include_extras=True)
    return {field: _quantity(hints.get(field)) or Quantity() for field in kind._fields}  # type: ignore[attr-defined]


def _quantity(hint: Any) -> Quantity | None:
    if get_origin(hint) is Annotated:
        return next((item for item in hint.__metadata__ if isinstance(item, Quantity)), _quantity(get_args(hint)[0]))
    return next((found for part in get_args(hint) if (found := _quantity(part))), None)


def attach(group: h5py.Group, name: str, dims: tuple[str, ...] = ()) -> None:
    """Put a dimension scale on every axis: the field of that name where there is one, an index otherwise."""
    dataset = group.get(name)
    if not isinstance(dataset, h5py.Dataset):
        return
    for axis, length in enumerate(dataset.shape):
        wanted = dims[axis] if axis < len(dims) else f"{name}_{axis}"
        scale = _scale(group, wanted, length, repeated=wanted in dims[:axis])
        if scale.name != dataset.name:
            dataset.dims[axis].attach_scale(scale)


def _scale(group: h5py.Group, name: str, length: int, repeated: bool) -> h5py.Dataset:
    while name in group and (repeated or not _fits(group[name], length)):  # the same axis twice, or another length
        name, repeated = f"{name}_2", False
    if name not in group:
        scale = group.create_dataset(name, data=np.arange(length))
        scale.attrs["units"] = "1"
        scale.make_scale(NO_COORDINATE % length)
    elif not group[name].is_scale:
        group[name].make_scale(name)
    return group[name]


def _fits(item: h5py.Group | h5py.Dataset, length: int) -> bool:
    return isinstance(item, h5py.Dataset) and item.shape == (length,) and not len(item.dims[0])


def _nexus(group: h5py.Group, quantities: Mapping[str, Quantity]) -> None:
    """Say what to plot: the first real field over an axis of its own, one with errors before one without."""
    plotted = [
        field
        for field, quantity in sorted(quantities.items(), key=lambda pair: not pair[1].error)
        if isinstance(group.get(field), h5py.Dataset) and len(group[field].shape) == 1 and group[field].dtype.kind in "fi"
        and quantity.dims and quantity.dims != (field,) and len(group[field]) and len(group[field].dims[0])
        and group[field].dims[0][0].dtype.kind in "fi"
    ]  # fmt: skip
    group.attrs["NX_class"] = "NXdata" if plotted else "NXcollection"
    if plotted:
        group.attrs["signal"] = plotted[0]
        group.attrs["axes"] = [group[plotted[0]].dims[0][0].name.rpartition("/")[2]]

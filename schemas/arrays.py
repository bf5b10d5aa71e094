"""Columns of the logs between NumPy and Arrow."""

from typing import Any

import numpy as np
import pyarrow as pa

from schemas.errors import ArtifactError


def to_arrow(kind: pa.DataType, values: np.ndarray) -> pa.Array:
    """Values (n,) or (n, d) as a column of `kind`; NaN, which only a missing estimate gives, becomes null."""
    if pa.types.is_fixed_size_list(kind):
        return pa.FixedSizeListArray.from_arrays(pa.array(values.ravel(), type=kind.value_type), type=kind)
    if pa.types.is_dictionary(kind):
        known, codes = np.unique(values, return_inverse=True)
        return pa.DictionaryArray.from_arrays(
            pa.array(codes, kind.index_type), pa.array(known.tolist(), kind.value_type)
        )
    if pa.types.is_floating(kind):
        return pa.array(values.astype(kind.to_pandas_dtype()), type=kind, from_pandas=True)
    return pa.array(values.astype(kind.to_pandas_dtype()), type=kind)


def constant(kind: pa.DataType, value: Any, length: int) -> pa.Array:
    """The same value in every row."""
    if pa.types.is_dictionary(kind):
        return pa.DictionaryArray.from_arrays(pa.array(np.zeros(length, np.int32), pa.int32()), pa.array([value]))
    return pa.array(np.full(length, value, kind.to_pandas_dtype()), kind)


def to_numpy(column: pa.Array | pa.ChunkedArray) -> np.ndarray:
    """A column as (n,), a list column as (n, d); null of a float is NaN, words are strings."""
    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if pa.types.is_fixed_size_list(array.type):
        if array.null_count:
            raise ArtifactError(f"a log is damaged or foreign: {array.null_count:,} of its lists are null")
        return array.flatten().to_numpy(zero_copy_only=False).reshape(len(array), array.type.list_size)
    if pa.types.is_dictionary(array.type):
        return np.array(array.to_pylist(), dtype=str)
    return array.to_numpy(zero_copy_only=False)


def with_own_words(table: pa.Table) -> pa.Table:
    """Without the words of other rows in its dictionaries, in one chunk: the same rows make the same file."""
    columns = []
    for column, field in zip(table.columns, table.schema, strict=True):
        if pa.types.is_dictionary(field.type):
            column = column.cast(field.type.value_type).combine_chunks().dictionary_encode().cast(field.type)
        columns.append(column)
    return pa.Table.from_arrays(columns, schema=table.schema).combine_chunks()

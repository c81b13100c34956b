"""Optimal assignment of rows to columns; scipy's would need 47 MB in every camera process."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def assign(costs: npt.NDArray[np.float64], impossible: float) -> dict[int, int]:
    """Return the column of each row with the smallest sum of costs.

    Shortest augmenting paths (Jonker and Volgenant, 1987).

    Args:
        costs: cost of each pair, shape (rows, columns).
        impossible: pairs with at least this cost are not made.

    Returns:
        Column by row, without unassigned rows.
    """
    rows, columns = costs.shape
    if rows == 0 or columns == 0:
        return {}
    if rows > columns:
        return {row: column for column, row in assign(costs.T, impossible).items()}
    row_price, column_price = np.zeros(rows), np.zeros(columns)
    row_of, column_of = np.full(columns, -1), np.full(rows, -1)
    for start in range(rows):
        shortest = np.full(columns, np.inf)
        via = np.full(columns, -1)
        done = np.zeros(columns, bool)
        row, end, length = start, -1, 0.0
        while end < 0:
            through = length + costs[row] - row_price[row] - column_price
            better = ~done & (through < shortest)
            shortest[better], via[better] = through[better], row
            column = int(np.argmin(np.where(done, np.inf, shortest)))
            length = float(shortest[column])
            done[column] = True
            row = int(row_of[column])
            if row < 0:
                end = column
        row_price[start] += length
        for column in np.flatnonzero(done).tolist():
            if row_of[column] >= 0:
                row_price[row_of[column]] += length - shortest[column]
            column_price[column] -= length - shortest[column]
        row = -1
        while row != start:
            row = int(via[end])
            row_of[end] = row
            column_of[row], end = end, int(column_of[row])
    return {
        int(row): column
        for column, row in enumerate(row_of)
        if row >= 0 and costs[row, column] < impossible
    }

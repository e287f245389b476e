"""What a data file holds."""

from whid.errors._explanation import CONFIG, FAILED, Explanation

CATALOGUE: dict[str, Explanation] = {
    "data-file": Explanation(
        "A data file is not where the config says, nor under $WHID_DATA.",
        "Give the path relative to the config, or set WHID_DATA to the folder that holds it.",
        CONFIG,
    ),
    "data-unreadable": Explanation(
        "A data file is empty, damaged, or not of the kind its name says.",
        "whid reads .csv .txt .tsv .dat (also .gz), .npz, .mat, .h5 and .hdf5: export it again as CSV; text under another "
        "ending can be renamed.",
        CONFIG,
    ),
    "data-cell": Explanation(
        "A cell of a text file is not a number, or a row has too few or too many cells.",
        "Correct the row, or give `delimiter:`, `decimal:` or `header_lines:`; empty a cell that was not measured. Times "
        "are numbers, or written 2024-03-05T10:00:00.25 or 10:00:00.25; leave others out and give `dt:`.",
        CONFIG,
    ),
    "data-column": Explanation(
        "A column that the config names is not in the file, or cannot be guessed.",
        "Name the columns, by heading or by number from 0: `columns: {time: …, input: …, output: …}` in a config, "
        "`--columns time=…,input=…,output=…` on the command line; without a time column `dt:` or `--dt`. `whid ingest FILE` "
        "shows them.",
        CONFIG,
    ),
    "data-scalar": Explanation(
        "An operation names a single number that the file does not hold.",
        "See what the file holds with `whid ingest FILE`, or write the number itself.",
        CONFIG,
    ),
    "data-operation": Explanation(
        "A column operation cannot be done on this record.",
        "`whid kinds KIND` (such as `whid kinds lowpass`) shows its keys; a cutoff must lie below half the sampling rate.",
        CONFIG,
    ),
    "data-length": Explanation(
        "Columns differ in length, or the record is too short to identify anything.",
        "Give columns of one length and at least 16 samples; `crop` acts on all columns.",
        CONFIG,
    ),
    "data-missing": Explanation(
        "Samples are missing (NaN, empty cells, or rows left out).",
        "Choose `missing: mask` (a fit skips them) or `missing: interpolate`, `--missing` for `whid ingest`; a missing "
        "input can only be interpolated.",
        CONFIG,
    ),
    "data-time-order": Explanation(
        "The time column does not increase.",
        "Sort or de-duplicate the rows, or leave the column out and give `dt:` or `rate_hz:` (`--columns "
        "input=…,output=… --dt …`).",
        CONFIG,
    ),
    "data-time-step": Explanation(
        "The time column is not uniform to 1 %, or contradicts `dt:` or `rate_hz:`.",
        "Add `operations: [{kind: resample}]` to the record (`--resample` for `whid ingest`), or give the true `dt:` and "
        "leave the time column out.",
        CONFIG,
    ),
    "data-time-unit": Explanation(
        "The time column is in another unit than declared (milliseconds against seconds, say).",
        "Give `units: {time: ms}` (s, ms, us, ns, min or h).",
        CONFIG,
    ),
    "data-dead": Explanation(
        "A column never changes: a dead channel, or the wrong column.",
        "Check the wiring and `columns:`; see what the file holds with `whid ingest FILE`.",
        CONFIG,
    ),
    "data-range": Explanation(
        "A value is so large that it can be no measurement.",
        "Correct the row, or mark it missing (an empty cell) and choose `missing: mask`.",
        CONFIG,
    ),
    "data-swapped": Explanation(
        "The declared output moves before the declared input: the two look swapped.",
        "Exchange `input:` and `output:` under `columns:`; for an inverse model say `causal: false`.",
        CONFIG,
    ),
    "data-picture": Explanation(
        "The picture of a record cannot be written.",
        "Give a place that exists and may be written to with `--out`.",
        FAILED,
    ),
    "data-parts": Explanation(
        "A declared part does not fit into its record.",
        "Give `start:` and `stop:` in samples after all operations, half-open, or `parts: auto`.",
        CONFIG,
    ),
}

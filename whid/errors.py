"""Every fault whid can name: a code, what was wrong, where, and what to try (`whid explain CODE`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class Explanation(NamedTuple):
    """What a code means, what to try, and the exit code of a command that stops on it."""

    meaning: str
    remedy: str
    exit_code: int


CONFIG, FAILED, NOT_MEASURED = 2, 3, 5

# One line a code; `whid explain` prints this table, a test holds every raised code against it.
CATALOGUE: dict[str, Explanation] = {
    "file-access": Explanation(
        "The operating system refused a file: it is missing, may not be read or written, or the disk is full.",
        "Check the path, its permissions and the free space.",
        FAILED,
    ),
    "file-exists": Explanation(
        "A file that is to be written exists already; whid never overwrites one.",
        "Give another name, or move the file away.",
        CONFIG,
    ),
    "config-file": Explanation(
        "A config cannot be read: there is no such file, or it is no text, or far too long for a config.",
        "Check the path; save the file as UTF-8; put data into a data file and name it under `data:`.",
        CONFIG,
    ),
    "config-syntax": Explanation(
        "A config is not YAML as whid reads it: one document, spaces for indents, every key once, no tags.",
        "Correct the line; an editor that knows YAML shows the same fault.",
        CONFIG,
    ),
    "config-missing": Explanation(
        "A key that must be given is not there.", "Add it; `whid kinds NAME` shows the keys of a kind.", CONFIG
    ),
    "config-unknown": Explanation(
        "A key that whid does not know stands in a config.",
        "Correct or remove it; `whid kinds NAME` shows the keys of a kind.",
        CONFIG,
    ),
    "config-value": Explanation(
        "A value is not of the kind, or not in the range, that its key allows.",
        "Write what the message allows; text that looks like a number needs quotes.",
        CONFIG,
    ),
    "config-source": Explanation(
        "A study says twice, or not at all, where its records come from.",
        "Give plant and experiment (simulated), or data (one measured record), or records (several).",
        CONFIG,
    ),
    "config-override": Explanation(
        "A `--set` names a place that the config does not have.",
        "Write it as `--set plant.chain[1].breaks[0]=-2.5`; lists count from 0.",
        CONFIG,
    ),
    "config-kind": Explanation("A `kind:` names nothing that whid knows.", "List what there is with `whid kinds`.", CONFIG),
    "trace-effect": Explanation(
        "`trace:` names an effect at a place where it cannot be.",
        "Write a kind (`saturation`) or a kind at a place (`saturation@output`); `whid kinds effects` lists them.",
        CONFIG,
    ),
    "block-parameters": Explanation(
        "A block's numbers contradict each other or do not describe a block.",
        "`whid kinds KIND` (such as `whid kinds piecewise`) shows its keys and its equation.",
        CONFIG,
    ),
    "block-no-steady-state": Explanation(
        "A block has no steady state at this input (an integrator, or a feedback that does not settle).",
        "Use `initial: rest` or `initial: free`.",
        FAILED,
    ),
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
    "memory": Explanation(
        "A study would need more memory than it may have.",
        "Allow more with `--max-memory 8GB`, use fewer samples (a shorter or decimated file), or a method that goes through "
        "them in chunks: memoryless, wiener_hammerstein.",
        CONFIG,
    ),
    "run-folder": Explanation(
        "The folder of a run cannot be made or written.",
        "Check the permissions and the free space of `--out`.",
        FAILED,
    ),
    "run-not-found": Explanation(
        "There is no finished run here.",
        "Give the folder that `whid run` printed, such as runs/starter-0123456789.",
        CONFIG,
    ),
    "result-unreadable": Explanation(
        "A result file is damaged, or was not written by whid.",
        "Run the study again; its config.yaml stands beside the result.",
        CONFIG,
    ),
    "method-failed": Explanation(
        "The identification stopped on a fault that has no name of its own.",
        "What was finished before is in the run folder, the details are in its log.txt; this is a bug, please report it.",
        FAILED,
    ),
    "interrupted": Explanation(
        "The run was interrupted from the keyboard.", "What was finished is in the run folder; run again for the rest.", 130
    ),
    "stage-too-short": Explanation(
        "A part is too short for its stage: no settled samples, or no whole period after the lead.",
        "Hold levels longer, measure more periods, sample faster, or set fewer lead periods.",
        FAILED,
    ),
    "statistics-only": Explanation(
        "Only levels and harmonics were kept, and the method came to need samples.",
        "Run a sweep with `--full-records`, a long record with more `--max-memory`, or use stronger sines.",
        FAILED,
    ),
    "stage-no-model": Explanation(
        "No stable linear blocks explain the harmonics of the sines: the nonlinearity of the levels does not fit them.",
        "Add levels where the sines run, or let the sines stay inside one piece; what was found before is kept.",
        FAILED,
    ),
    "disturbance-size": Explanation("A disturbance has no size, or two.", "Give exactly one of `std` and `snr_db`.", CONFIG),
    "disturbance-unstable": Explanation(
        "A coloured noise would grow without bound.",
        "Every root of z^p − a₁z^(p−1) − … − a_p must lie inside the unit circle; of order 1: |a₁| < 1.",
        CONFIG,
    ),
    "part-parameters": Explanation(
        "An experiment part's fields contradict each other or do not describe an input.",
        "`whid kinds KIND` (such as `whid kinds sine`) shows its keys and its equation.",
        CONFIG,
    ),
    "feedback-no-solution": Explanation(
        "An algebraic feedback has no solution at some input: the loop's residual jumps over zero or never reaches it.",
        "Use `solve: delay`, put dynamics into the loop, or remove the jump from it.",
        FAILED,
    ),
    "sweep-running": Explanation(
        "Another process is at the same sweep: the same study, data and output folder.",
        "Wait until it ends, or stop it; what it finished is kept and goes on with the same command.",
        FAILED,
    ),
    "sweep-mixed": Explanation(
        "The journal of an unfinished sweep is that of another config, other data or another version of whid.",
        "Remove the .unfinished file to begin anew, or give another --out.",
        FAILED,
    ),
    "sweep-failed": Explanation(
        "A repeat of a sweep failed, and --fail-fast asked to stop there.",
        "Mend what the message says; the same command without --fail-fast goes on with the rest.",
        FAILED,
    ),
    "sweep-engine": Explanation(
        "The executor or cluster of a sweep is not there, or went away.",
        "Check the scheduler's address, or leave --scheduler out; what was finished is kept.",
        FAILED,
    ),
    "sweep-missing": Explanation(
        "`whid sweep` was given a study without a `sweep:` section.",
        "Add `sweep: {over: {plant.noise.std: [0.1, 0.2]}, repeats: 10}`, or use `whid run`.",
        CONFIG,
    ),
    "table-none": Explanation(
        "`whid table` was given a study without a `table:` section, or a folder without such a study.",
        "Add `table: {kind: …}`; `whid kinds papers` lists what there is.",
        CONFIG,
    ),
    "table-failed": Explanation(
        "The runs that a table is made of failed: there is nothing to put into it.",
        "`whid run CONFIG` shows one such run and what it says; the plant, the plan or the method changed.",
        FAILED,
    ),
    "table-expected": Explanation(
        "`whid table --check` has nothing to compare with, or what it has is no such table.",
        "Run `whid table CONFIG` and move the `.expected.csv` of its folder beside the config.",
        NOT_MEASURED,
    ),
    "next-nothing": Explanation(
        "A run has no experiment to propose: its method asked for none, or all were performed.",
        "See in the summary what is missing or in doubt; more of the same experiments makes every error smaller.",
        FAILED,
    ),
    "fit-no-data": Explanation(
        "There is nothing to fit: no record has valid samples for estimation, or the model has no free number.",
        "Declare parts with `use: estimation`; remove `fix: true` from what is to be fitted.",
        CONFIG,
    ),
    "fit-parameter": Explanation(
        "A number to hold or to tie is not in the model.",
        "Write its path in the tree, such as `chain.0.den.1`; lists count from 0.",
        CONFIG,
    ),
    "fit-start": Explanation(
        "The model cannot be simulated at its start values: its output is not a finite number.",
        "Give start values that are stable (poles left of the axis; in the unit circle if discrete), and check that"
        " the record's input has no holes.",
        CONFIG,
    ),
    "method-no-data": Explanation(
        "No sample of any record may be used for estimation.",
        "Give a part, or a record, `use: estimation` (it is the default).",
        FAILED,
    ),
    "method-rates": Explanation(
        "The method needs records of one sampling time.",
        "Resample them alike (`{kind: resample}`, `{kind: decimate}`), or study them one by one.",
        FAILED,
    ),
    "stage-no-linear-fit": Explanation(
        "No stable transfer function goes through the measured frequency response.",
        "Give other `orders:`; see in the result's best linear approximation whether the record is long and excited enough.",
        FAILED,
    ),
    "stage-no-split": Explanation(
        "Poles and zeros of the linear approximation cannot be shared between front and back as asked.",
        "Leave `orders:` out, or change them: complex pairs stay together, a block has no more zeros than poles.",
        FAILED,
    ),
    "stage-one-sided": Explanation(
        "The domain of a curve reaches beyond the data: a window at a node has samples on one side of it only.",
        "Give a `domain:` that the input fills, or leave it out; or drive the input further.",
        FAILED,
    ),
    "stage-rank-one": Explanation(
        "A curve cannot be seen: all samples of a window, or of the record, have one input or very few.",
        "Use `report: least_squares` (no windows) or a larger `half_width:` where the input is a staircase; "
        "lower `order:`; or drive with noise or a slow sine.",
        FAILED,
    ),
    "stage-not-invertible": Explanation(
        "The curve turns inside its domain: one output belongs to several inputs, and no equaliser can tell them apart.",
        "Give a `domain:` on which it rises or falls throughout; the message names one.",
        FAILED,
    ),
    "stage-extrapolates": Explanation(
        "An equaliser was asked for over a domain that the data do not cover: it would invert what was never measured.",
        "Give the `domain:` in the message, leave it out, or drive the input further.",
        FAILED,
    ),
    "fit-no-model": Explanation(
        "A fit needs a model to start from, and the config declares none.",
        "Add `model: {chain: […]}`: its structure counts, its numbers are start values.",
        CONFIG,
    ),
    "method-nothing-moves": Explanation(
        "No sine moves the output beyond the noise: every piece of the input nonlinearity that was tried is flat.",
        "Put sines where the staircase rises, make them larger, or average more periods.",
        FAILED,
    ),
    "method-no-static-curve": Explanation(
        "Under no sine is the output one static curve of a phase-shifted sine: each of them left its affine piece.",
        "Make the sines smaller, put them in the middle of a piece, or give a higher `degree`.",
        FAILED,
    ),
    "method-even-curve": Explanation(
        "The output nonlinearity is even about the middle of every sine, so that phases a quarter turn apart fit alike.",
        "Move the sine's offset, or make it larger, so that the curve is not symmetric about its middle.",
        FAILED,
    ),
    "method-no-sines": Explanation(
        "The method needs sines about zero, with two settled periods or more, and the records have none for it.",
        "Add `{kind: sine, offset: 0, …}` with `use: estimation` and more periods; declare the sines of measured data.",
        FAILED,
    ),
    "method-constant-output": Explanation(
        "The sines do not move the output: each stays within the backlash, or the borders never let it move.",
        "Try several amplitudes, an offset, lower frequencies. Where the rising border lies above the falling one, no sine "
        "moves it at any amplitude: start it from another side, with a step far beyond the working range.",
        FAILED,
    ),
    "method-few-frequencies": Explanation(
        "The frequency response was measured at too few frequencies for a transfer function.",
        "Add sines at three frequencies or more; the response and the borders that were found are kept.",
        FAILED,
    ),
    "method-still-output": Explanation(
        "The output is the same at every level of the input, but for noise: there is no curve to find.",
        "Drive over a wider range, or on the other side, where the output moves; or check that the input reaches it "
        "(columns, wiring).",
        FAILED,
    ),
    "method-no-levels": Explanation(
        "The method needs constant levels of the input, and the records have fewer than two for it.",
        "Add a staircase with `use: estimation`; for measured data declare the holds, or `parts: auto` to find "
        "them. For noise, multisines or random steps use `identify: {kind: parametric}`.",
        FAILED,
    ),
}


class WhidError(Exception):
    """One named fault; `str()` is one line, `where: message`."""

    def __init__(self, code: str, message: str, where: str = "") -> None:
        super().__init__(f"{where}: {message}" if where else message)
        self.code, self.message, self.where = code, message, where

    @property
    def exit_code(self) -> int:
        """Return the exit code of a command that stops on this fault."""
        return CATALOGUE[self.code].exit_code

    @property
    def remedy(self) -> str:
        """Return what to try."""
        return CATALOGUE[self.code].remedy


class Faults(WhidError):
    """Several faults reported at once, each with its place."""

    def __init__(self, faults: Sequence[WhidError]) -> None:
        super().__init__(faults[0].code, "\n".join(str(fault) for fault in faults))
        self.faults = tuple(faults)

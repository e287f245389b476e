"""Files, folders, memory, sweeps and tables: what surrounds an identification."""

from whid.errors._explanation import CONFIG, FAILED, NOT_MEASURED, Explanation

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
    "interrupted": Explanation(
        "The run was interrupted from the keyboard.", "What was finished is in the run folder; run again for the rest.", 130
    ),
    "statistics-only": Explanation(
        "Only levels and harmonics were kept, and the method came to need samples.",
        "Run a sweep with `--full-records`, a long record with more `--max-memory`, or use stronger sines.",
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
}

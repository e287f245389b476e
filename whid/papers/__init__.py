'''Tables and figures of the papers, regenerated: one file each, the folder is the registry.

A config under `configs/<paper>/` names its tables and holds what the paper printed:

    table:
      kind: brouri2019_table_4_1            # papers/brouri2019_table_4_1.py, class Brouri2019Table41
      runs: 20                              # of `whid table`, which must be quick; full_runs are those of `--full`
      full_runs: 300
      published: [{quantity: front.gain@0.02, truth: 0.97, value: 0.98}, …]

(a list where one study gives several). `whid table CONFIG` runs them; `whid table --all` every config with a `table:`.

**Adding one is adding one file**, here, and `table:` in a config. A table is a frozen dataclass as a block is: its fields
are its keys beside `runs`, `full_runs` and `published`. The base owns the loop, the file its difference, `regenerate`:

    @dataclass(frozen=True, kw_only=True)
    class JerajMathewsTable1(Exhibit):
        """Variances of the node values over 50 runs ([Jeraj and Mathews], Table 1)."""

        clip: float = 1.0                                     # a key of its own

        def regenerate(self, bench: Bench) -> Regenerated:
            found = bench.metrics()                           # name → (runs, 2): value, standard error; NaN where it failed
            rows = [
                Row(f"variance of {name}", published=self.printed(name),            # the `value` of the config
                    paper=variance(found[f"paper.{name}"][:, 0]), efficient=variance(found[name][:, 0]), bound=crb)
                for name, crb in …
            ]
            return Regenerated("Table 1", rows, notes=("the paper's input scale is not given: 1/3 reproduces it",))

`bench` is the study of the config and all the randomness there is:

    bench.runs                      runs or full_runs; bench.full tells which
    bench.plant, .experiments, .method, .seed
    bench.results(count, **changes) Results of the study, run after run; changes are those of the study: identify=…, plant=…
    bench.metrics(count, **changes) their metrics as arrays; a run that failed is NaN and a note says how many did and why
    bench.rng(*key)                 a generator of its own, for what is simulated without a run (moments over 600 records)

**Columns**: quantity | published | paper's method, ours | efficient, ours | bound. `published` is the paper's printed
number, `bound` what no unbiased estimator beats (Cramér-Rao) or the true value, as `headings` says; a column without
any entry is not shown. A number with a standard error is a `Measured`, always, where it comes from random draws:
`mean`, `rmse`, `variance` of `_monte_carlo.py` make them. What the paper got wrong, what is lost and was redrawn from
our plant, goes into `notes`, in words.

**Bars** are `Check`s in `bars`: `held("A6 RMSE", rmse(e), below=.003)` passes when the interval of the figure at its
count reaches the bar. A breached one ends `whid table` with exit code 4, with and without `--full`.

**Figures** are tables with a picture: `draw` is a function of a matplotlib Figure (import nothing of matplotlib at the
top of a file: every `whid check` lists this folder). Their rows are the numbers that the eye would read off: positions
of corners, heights of rings, the largest distance between two curves; `--check` compares them. brouri2019_figure_4_1.py
is an example.

**Expected**: `whid table CONFIG` writes `<config>.expected.csv` into its folder; moved beside the config it is what
`--check` compares with. Seeds and counts are those of the config, so the draws are the same and only code and libraries
can change a number: it may move by its own standard error (`tolerance` of a Row replaces that), one without by 1e-3 of
itself; text must be the same, and no row may come or go. Where a table's numbers depend on a decision that a rounding
error could flip, say so by a `tolerance`.

**How quick**: `--all` may take 3 minutes on one core in total, so 35 s a paper at the counts of `runs`.

**A paper's estimate in one run**: a stage's `metrics()` names the paper's own (corrected) estimate `paper.<name>` and
the efficient one `<name>`; `compare_with_paper: true` in any study then prints both side by side, and no method does
more for it.

Floor: above stages, methods, simulate, summary and plots, below config, which reads the keys; what runs a study comes
in by `bench`, so nothing here imports the flow.
'''

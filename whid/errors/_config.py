"""What a study says, and what its blocks, parts and disturbances refuse."""

from whid.errors._explanation import CONFIG, FAILED, Explanation

CATALOGUE: dict[str, Explanation] = {
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
}

"""What a fit, a stage or a method cannot do with its records."""

from whid.errors._explanation import CONFIG, FAILED, Explanation

CATALOGUE: dict[str, Explanation] = {
    "method-failed": Explanation(
        "The identification stopped on a fault that has no name of its own.",
        "What was finished before is in the run folder, the details are in its log.txt; this is a bug, please report it.",
        FAILED,
    ),
    "stage-too-short": Explanation(
        "A part is too short for its stage: no settled samples, or no whole period after the lead.",
        "Hold levels longer, measure more periods, sample faster, or set fewer lead periods.",
        FAILED,
    ),
    "stage-no-model": Explanation(
        "No stable linear blocks explain the harmonics of the sines: the nonlinearity of the levels does not fit them.",
        "Add levels where the sines run, or let the sines stay inside one piece; what was found before is kept.",
        FAILED,
    ),
    "stage-unseen-pole": Explanation(
        "The frequency response asks for a pole that the records cannot show: slower than the longest of them lasts, so "
        "that its static gain is unknown, or faster than a sample.",
        "Add sines of lower frequency and longer holds or records, until the gain stops rising; or sample faster. The "
        "response that was found is kept.",
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
    "method-one-sided": Explanation(
        "Every loop is one-sided: the output follows one border of the backlash and holds on the way back, so that nothing "
        "tells where the other border lies.",
        "Try other amplitudes, larger and smaller (a larger one need not help), lower frequencies, or start from another "
        "side, with a step far beyond the working range; average more periods where the way back may be small.",
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

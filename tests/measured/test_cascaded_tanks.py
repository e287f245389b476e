"""Cascaded tanks: the chain of the config beside a linear model of as many poles, on parts kept aside."""

from dataclasses import replace

import numpy as np
import pytest

from tests.measured_data import DATA, measured_study
from whid.experiments.noise_band import NoiseBand
from whid.files.ingest import ingest
from whid.methods._windows import Windows
from whid.predict import predict
from whid.stages._cascade import Filter
from whid.stages.linear_in_time import linear_in_time


@pytest.fixture(scope="module")
def tanks():
    study = measured_study("cascaded_tanks")
    return study.identify, ingest(study.data, DATA).record


@pytest.mark.parametrize(("start", "stop"), [(512, 1024), (512, 768)])
def test_the_bent_line_beats_a_straight_one(tanks, start, stop):
    method, record = tanks
    parts = [NoiseBand(start=0, stop=start), NoiseBand(start=start, stop=stop, use="report")]
    parts += [NoiseBand(start=stop, stop=1024)] if stop < 1024 else []
    record = replace(record, parts=tuple(parts))
    seen, kept = record.without("report"), record.using("report")
    model = list(method([seen]))[-1]
    chain = float(np.sqrt(np.mean((predict(model.system.tree, record) - record.y)[kept] ** 2)))
    windows = Windows([seen], lead=100).every()
    fit = linear_in_time(windows, 2, record.dt)
    x, used = Filter.of_roots(fit.zeros, fit.poles).through(record.u), windows[0].use
    slope, offset = np.polyfit(x[: len(used)][used], windows[0].y[used], 1)
    linear = float(np.sqrt(np.mean((offset + slope * x - record.y)[kept] ** 2)))
    print(f"report rms {chain:.4f} V, linear {linear:.4f} V")
    assert chain < linear

"""The Wiener-Hammerstein benchmark beside jax-sysid and sysidentpy (`pip install whid[compare]`): one record, one split.

Each as its own documentation begins: jax-sysid a state-space model with neural state and output functions (six states),
sysidentpy a polynomial NARX model by forward selection. Time to fit and RMSE of a free simulation on the last fifth.
"""

import time

import numpy as np
import pytest

from tests.measured_data import DATA, measured_study
from whid.files.ingest import ingest
from whid.predict import predict

ESTIMATION, REPORT = slice(5200, 80_000), slice(80_000, 100_000)
SETTLED = 1000  # samples of the report part that other models may settle in


@pytest.fixture(scope="module")
def bench():
    study = measured_study("wh_sysid09")
    return study.identify, ingest(study.data, DATA).record


@pytest.fixture(scope="module")
def ours(bench):
    method, record = bench
    began = time.process_time()
    model = list(method([record.without("report")]))[-1]
    seconds = time.process_time() - began
    error = predict(model.system.tree, record) - record.y
    return told("whid, orders (3, 3)", seconds, error[REPORT][SETTLED:])


def told(name, seconds, error):
    rmse = 1e3 * float(np.sqrt(np.mean(error**2)))
    print(f"{name}: RMSE {rmse:.4g} mV, {seconds:.1f} s of processor time")
    return rmse, seconds


@pytest.mark.slow
def test_beside_jax_sysid(bench, ours):
    pytest.importorskip("jax_sysid", reason="jax-sysid is not installed: pip install whid[compare]")
    import jax
    import jax.numpy as jnp
    from jax_sysid.models import Model

    jax.config.update("jax_enable_x64", True)
    record = bench[1]
    u, y = ((x - x[ESTIMATION].mean()) / x[ESTIMATION].std() for x in (record.u, record.y))
    states, hidden, rng = 6, 10, np.random.default_rng(0)

    @jax.jit
    def state(x, u, p):
        return p[0] @ x + p[1] @ u + p[2] @ jnp.tanh(p[3] @ x + p[4] @ u + p[5])

    @jax.jit
    def output(x, u, p):
        return p[6] @ x + p[7] @ jnp.tanh(p[8] @ x + p[9])

    model = Model(states, 1, 1, state_fcn=state, output_fcn=output)
    shapes = [
        (states, 1),
        (states, hidden),
        (hidden, states),
        (hidden, 1),
        (hidden,),
        (1, states),
        (1, hidden),
        (hidden, states),
    ]
    model.init(params=[0.5 * np.eye(states), *(0.1 * rng.standard_normal(shape) for shape in shapes), np.zeros(hidden)])
    model.loss(rho_x0=1e-4, rho_th=1e-8)
    model.optimization(adam_epochs=100, lbfgs_epochs=300, iprint=-1)
    began = time.process_time()
    model.fit(y[ESTIMATION, None], u[ESTIMATION, None])
    seconds = time.process_time() - began
    simulated, _ = model.predict(np.zeros(states), u[REPORT, None])
    error = (np.asarray(simulated).ravel() - y[REPORT]) * record.y[ESTIMATION].std()
    rmse, _ = told("jax-sysid, 6 states, 10 neurons, 100 Adam and 300 L-BFGS steps", seconds, error[SETTLED:])
    assert ours[0] < rmse
    assert ours[1] < seconds


@pytest.mark.slow
def test_beside_sysidentpy(bench, ours):
    pytest.importorskip("sysidentpy", reason="sysidentpy is not installed: pip install whid[compare]")
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    record = bench[1]
    u, y = (x[:, None] for x in (record.u, record.y))
    model = FROLS(
        order_selection=False, n_terms=40, xlag=6, ylag=6, basis_function=Polynomial(degree=3), estimator=LeastSquares()
    )
    began = time.process_time()
    model.fit(X=u[ESTIMATION], y=y[ESTIMATION])
    seconds = time.process_time() - began
    simulated = model.predict(X=u[REPORT], y=y[REPORT][: model.max_lag])
    error = np.nan_to_num(np.asarray(simulated).ravel() - record.y[REPORT], nan=np.inf)
    rmse, _ = told("sysidentpy, 40 of the polynomial terms of degree 3, six lags", seconds, error[SETTLED:])
    assert ours[0] < rmse
    assert ours[1] < seconds

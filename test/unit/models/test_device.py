"""Products on another device or in another precision: the same fits, certified in float64."""

from bench.shared.serial_arms import poses, samples_of, serial_arm
from gravity_comp_ros.errors import OptionError
from gravity_comp_ros.estimation.estimate import FitOptions
from gravity_comp_ros.estimation.fit import fit
from gravity_comp_ros.models.sparse.array_backend import Arrays
from gravity_comp_ros.models.sparse.lasso import LassoProblem
from gravity_comp_ros.models.sparse.regressor import EnergyDesign, TorqueDesign
from gravity_comp_ros.models.sparse.sparse_problem import SparseOptions
from gravity_comp_ros.simulation.arms import gravity_torque
import numpy as np
import pytest

NAMESPACES = ('numpy', 'array_api_strict', 'torch')
KINDS = pytest.mark.parametrize('kind', [TorqueDesign, EnergyDesign])


def designs_of(kind, arrays: Arrays, n_joints: int = 4):
    rng = np.random.default_rng(0)
    q = rng.uniform(-3, 3, (30, n_joints))
    weights = rng.uniform(0.5, 2.0, (30, n_joints if kind is EnergyDesign else 1))
    return kind(q, weights), arrays.design_type(kind)(q, weights)


@KINDS
@pytest.mark.parametrize('namespace', NAMESPACES)
@pytest.mark.parametrize('dtype, close', [('float64', 1e-12), ('float32', 1e-5)])
def test_products_are_those_of_numpy(kind, namespace, dtype, close):
    pytest.importorskip(namespace)
    device = 'cpu' if namespace == 'torch' else None
    reference, other = designs_of(kind, Arrays(namespace, dtype, device))
    r = np.random.default_rng(1).normal(size=(reference.n_rows, 3))
    expected = reference.correlate_many(r)
    for products in (other.correlate_many(r), other.reweighted(reference.row_weights.reshape(
            30, -1)).correlate_many(r)):
        assert products.dtype == np.float64
        np.testing.assert_allclose(products, expected, atol=close * np.abs(expected).max())
    np.testing.assert_array_equal(other.squared_norms(), reference.squared_norms())
    np.testing.assert_allclose(other.precise.correlate(r[:, 0]), expected[0],
                               atol=1e-12 * np.abs(expected).max())


@KINDS
@pytest.mark.parametrize('namespace', NAMESPACES)
def test_a_solution_in_float32_is_optimal_in_float64(kind, namespace):
    pytest.importorskip(namespace)
    reference, other = designs_of(kind, Arrays(namespace, 'float32'))
    b = 10 * reference.columns(np.array([5, 40, 61])).sum(axis=1)
    b += np.random.default_rng(2).normal(size=len(b))
    one, two = (LassoProblem(design, b, np.ones(81, dtype=bool)) for design in (reference, other))
    first, second = one.solve(0.1 * one.lambda_max), two.solve(0.1 * two.lambda_max)
    assert second.converged and second.certificate.violation < 1e-6
    assert second.certificate.gap < 1e-9
    np.testing.assert_array_equal(first.indices, second.indices)
    np.testing.assert_allclose(first.x, second.x, atol=1e-6)


@pytest.mark.parametrize('formulation', ['potential', 'per_joint'])
@pytest.mark.parametrize('arrays', [Arrays(dtype='float32'), Arrays('array_api_strict'),
                                    Arrays('torch'), Arrays('torch', 'float32', 'cpu')])
def test_whole_fits_agree(formulation, arrays):
    pytest.importorskip(arrays.namespace)
    q = poses(150, 4)
    samples = samples_of(q, gravity_torque(serial_arm(4), q), 0.1)
    default = fit(samples, FitOptions(formulation))
    other = fit(samples, FitOptions(formulation, SparseOptions(arrays=arrays)))
    assert other.converged
    for a, b in zip(default.model.torques, other.model.torques):
        np.testing.assert_array_equal(a.indices, b.indices)
        np.testing.assert_allclose(a.weights, b.weights, atol=1e-6)
    assert other.model.provenance['options']['sparse']['arrays']['dtype'] == arrays.dtype


def test_a_missing_namespace_is_reported_in_one_line():
    with pytest.raises(OptionError, match='dtype is float16; choose from'):
        Arrays(dtype='float16')
    with pytest.raises(OptionError, match='the namespace no_such_thing does not load') as error:
        Arrays('no_such_thing').design_type(TorqueDesign)
    assert '\n' not in str(error.value)

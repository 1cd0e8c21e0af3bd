"""TLC's server with two workers, all on loopback."""

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

from automcm_spec.model_checking import distributed_tlc, models, tlc
from automcm_spec.support import scratch

MODELS = {model.cfg: model for model in models.load()}


@pytest.fixture(autouse=True)
def the_port() -> Iterator[None]:
    """TLC's server has one port: one test at a time, whatever process it is in."""
    with scratch.locked("tlc-server"):
        yield


def shared(name: str, number: int = 2) -> tuple[distributed_tlc.Shared, list[Future[int]]]:
    with ThreadPoolExecutor(1 + number) as pool:
        server = pool.submit(distributed_tlc.serve, MODELS[name], timeout_s=120)
        workers = [
            pool.submit(distributed_tlc.work, "127.0.0.1", timeout_s=120) for _ in range(number)
        ]
    return server.result(), workers


@pytest.mark.slow
def test_two_workers_find_the_states_of_one() -> None:
    found, workers = shared("one_by_two")
    assert found.problem is None
    assert found.distinct_states == MODELS["one_by_two"].distinct_states
    assert len([worker.result() for worker in workers]) == 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["any_lease_order", "no_busy_refusal"])
def test_a_violated_invariant_and_a_violated_action_property_are_found(name: str) -> None:
    found, _ = shared(name, 1)
    assert (found.outcome, found.problem) == ("violates", None)


@pytest.mark.slow
def test_a_worker_waits_for_its_server() -> None:
    with pytest.raises(tlc.TlcError) as error:
        distributed_tlc.work("127.0.0.1", timeout_s=1)
    assert error.value.kind == "timeout"


def test_a_server_without_workers_waits() -> None:
    with pytest.raises(tlc.TlcError) as error:
        distributed_tlc.serve(MODELS["one_by_two"], timeout_s=1)
    assert error.value.kind == "timeout"

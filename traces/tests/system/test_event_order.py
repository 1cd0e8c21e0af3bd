"""The order in which all views show events."""

from __future__ import annotations

from automcm_traces.system.event_order import Head, Node, Ordered


def rows(
    *times: list[int],
    needs: dict[Node, Node] | None = None,
    guessed: set[Node] | None = None,
    ahead: list[int] | None = None,
    beside: dict[Node, Node] | None = None,
) -> tuple[list[tuple[Node, ...]], list[list[tuple[Node, Node]]]]:
    """The rows of logs with events at these times, and the cycles found."""
    feeds = [
        iter(
            [
                Head((i, k), (i, k), t, (needs or {}).get((i, k)), (i, k) not in (guessed or ()))
                for k, t in enumerate(log)
            ]
        )
        for i, log in enumerate(times)
    ]
    cycles: list[list[tuple[Node, Node]]] = []
    found = Ordered(feeds, ahead or [0] * len(times), beside, cycles.append)
    return list(found), cycles


def alone(*nodes: Node) -> list[tuple[Node, ...]]:
    return [(node,) for node in nodes]


def test_the_earliest_by_aligned_clocks_comes_first_then_the_lowest_log() -> None:
    found, _ = rows([1005, 1010], [5, 9], ahead=[1000, 0])
    assert found == alone((0, 0), (1, 0), (1, 1), (0, 1))


def test_a_reception_comes_after_its_transmission_whatever_the_clocks() -> None:
    found, cycles = rows([5, 6], [9000, 9001], needs={(0, 0): (1, 1)})
    assert found == alone((1, 0), (1, 1), (0, 0), (0, 1)) and not cycles


def test_of_a_cycle_a_guess_gives_way_and_no_cycle_is_reported() -> None:
    needs = {(0, 0): (1, 1), (1, 0): (0, 1)}
    found, cycles = rows([1, 2], [1, 2], needs=needs, guessed={(1, 0)})
    assert found == alone((1, 0), (1, 1), (0, 0), (0, 1)) and not cycles
    found, cycles = rows([1, 2], [1, 2], needs=needs)
    assert len(found) == 4 and cycles == [[((0, 0), (1, 1)), ((1, 0), (0, 1))]]


def test_after_a_pair_both_logs_go_on_from_one_time() -> None:
    found, _ = rows([0, 100, 200], [0, 150, 210], beside={(0, 0): (1, 0), (0, 1): (1, 1)})
    assert found == [((0, 0), (1, 0)), ((0, 1), (1, 1)), ((1, 2),), ((0, 2),)]


def test_a_pair_that_the_messages_tear_apart_becomes_two_rows() -> None:
    needs: dict[Node, Node] = {(0, 0): (1, 0), (3, 0): (2, 0)}  # A: 1 before 0; B: 0 before 1
    found, cycles = rows(*([[0, 1]] * 4), needs=needs, beside={(0, 0): (2, 0), (1, 0): (3, 0)})
    assert sorted(node for nodes in found for node in nodes) == [
        (i, k) for i in range(4) for k in range(2)
    ]
    place = {node: n for n, nodes in enumerate(found) for node in nodes}
    assert all(place[first] < place[then] for then, first in needs.items())
    assert sum(len(nodes) == 2 for nodes in found) == 1 and not cycles

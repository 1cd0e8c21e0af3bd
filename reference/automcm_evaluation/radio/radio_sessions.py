"""Sessions and drives whose messages go over ``TableRadio``, and their models."""

from __future__ import annotations

from functools import partial
from random import Random
from statistics import fmean as mean

from automcm.links.link import Link
from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.loss import loss_road
from automcm_evaluation.loss.loss_sessions import session
from automcm_evaluation.loss.loss_tables import four_messages, three_exchanges
from automcm_simulation.radio.radio_link import RadioLinks
from automcm_simulation.radio.table_radio import TableRadio
from automcm_simulation.road.simulation import Simulation

SAMPLES = 2000
"""States of the channel over which a model is averaged."""
FAR_APART_M = 1000.0
"""Between two samples: they have no shadowing in common."""
CAM_BYTES = 159
"""In JSON (docs/messages.md)."""


class OverRadio(Simulation):
    """A simulation over a ``TableRadio``.

    A station is where its application is; the second is ``apart_m`` further along the x axis, as
    if the road were as long.  ``load`` is the offered load of other stations.
    """

    def __init__(self, seed: int, *, apart_m: float, load: float) -> None:
        super().__init__(seed=seed)
        self._apart_m = apart_m
        self._links = RadioLinks(self.clock, TableRadio(seed, background=load), self._places)

    def link(self, station_id: int) -> Link:
        """As ``Simulation.link``."""
        return self._links.link(station_id)

    def _places(self) -> dict[int, tuple[float, float]]:
        found = {}
        for station_id, service in self.services.items():
            at = service.application.kinematics(self.clock.now())
            assert at is not None
            ahead = self._apart_m if station_id == 2 else 0.0
            found[station_id] = (at.x_mm / 1000 + ahead, at.y_mm / 1000)
        return found


def models(t_timeout: int, seed: int, *, apart_m: float, load: float) -> Values:
    """The mean ``loss`` of a CAM, and what the models of a session expect: with this loss for
    every copy (``even``), and with that of each state of the channel, which lasts as long as the
    session (``lasting``)."""
    radio = TableRadio(seed, background=load)
    losses = []
    for n in range(SAMPLES // 2):
        x = n * FAR_APART_M
        radio.move({1: (x, 0.0), 2: (x + apart_m, 0.0)})
        losses += [1 - radio.arrives(a, b, CAM_BYTES) for a, b in ((1, 2), (2, 1))]
    found: Values = {"loss": round(mean(losses), 5)}
    for name, model in (("three", three_exchanges), ("four", four_messages)):
        found[f"{name}_even"] = round(model(mean(losses), t_timeout), 5)
        found[f"{name}_lasting"] = round(mean([model(loss, t_timeout) for loss in losses]), 5)
    return found


def block(values: Values, seed: int) -> Values:
    """Sessions in one cell: how many ``agreed``, and what the models expect."""
    random = Random(seed)
    where = {"apart_m": values["distance_m"], "load": values["load"]}
    agreed = sum(
        session(OverRadio(random.getrandbits(31), **where), values["t_timeout"]).agreed
        for _ in range(values["trials"])
    )
    return {"agreed": agreed} | models(values["t_timeout"], seed % 2**31, **where)


def drives(values: Values, seed: int) -> Values:
    """Drives in one cell, as in ``loss``: a list for each figure."""
    over = partial(OverRadio, apart_m=values["distance_m"], load=values["load"])
    return loss_road.block(values, seed, over)

"""Messages of every type, reason and form, for tests of the codecs."""

from __future__ import annotations

from typing import Any, get_args

from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.messages import LIMIT, Cam, Message


def _examples() -> list[Message | Cam]:
    plain: dict[str, Any] = {message.type: message for message in sizes.plain()}
    far = messages.Trajectory(
        t0=-LIMIT, points=((LIMIT, -LIMIT, 0), (2048, 8192, -8193), (2050, 8193, 0))
    )
    driven = [
        one
        for each in (sizes.trajectory(2), sizes.trajectory(20), far)
        for one in sizes.carrying(each)
    ]
    details = {"lane": 2, "zone": [[0, 1, -7], {"open": True, "name": "B\u00e9\n"}], "": {}}
    extent = {"length_mm": 16_500, "width_mm": 2550}
    changed: list[tuple[Any, dict[str, Any]]] = [
        (driven[0], {"details": details | {"n": LIMIT}}),
        (driven[1], extent),
        (plain["Fin"], {"session": (2**32 - 1, LIMIT), "seq": 2**33}),
        (plain["CAM"], {"marks": ()}),
        (plain["CAM"], extent | {"station_type": 8, "sigma_mm": 700}),
    ]
    for reason in get_args(messages.RefusalReason):
        seq = 0 if reason in messages.ANSWER_REASONS else 2
        changed.append((plain["Acceptance"], {"reason": reason, "seq": seq}))
    for reason in get_args(messages.CancelReason):
        changed.append((plain["Cancel"], {"reason": reason, "seq": 0 if reason == "closed" else 3}))
    return [*plain.values(), *driven, *(each.model_copy(update=to) for each, to in changed)]


EXAMPLES = _examples()

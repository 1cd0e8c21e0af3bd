"""The reference implementation of a station, and the names that a program needs (docs/library.md).

Everything else can be imported from its module, but may change.  A name is imported when it is
first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from automcm.core.station import Station
    from automcm.links.clock import AsyncioClock, VirtualClock
    from automcm.links.link import Link
    from automcm.links.simulated_radio import Channel, Radio
    from automcm.links.udp_link import UdpLink
    from automcm.service.application import (
        Advertised,
        AgreedManeuver,
        Application,
        Choice,
        Kinematics,
        Proposal,
        Service,
    )
    from automcm.service.event_log import open_log
    from automcm.service.service import McService
    from automcm_spec.vocabulary import messages
    from automcm_spec.vocabulary.application import Request
    from automcm_spec.vocabulary.messages import Session, Trajectory
    from automcm_spec.vocabulary.parameters import Parameters

    __version__: str

_MODULES = {
    "automcm.core.station": ("Station",),
    "automcm.links.clock": ("AsyncioClock", "VirtualClock"),
    "automcm.links.link": ("Link",),
    "automcm.links.simulated_radio": ("Channel", "Radio"),
    "automcm.links.udp_link": ("UdpLink",),
    "automcm.service.application": (
        *("Advertised", "AgreedManeuver", "Application", "Choice", "Kinematics", "Proposal"),
        "Service",
    ),
    "automcm.service.event_log": ("open_log",),
    "automcm.service.service": ("McService",),
    "automcm_spec.vocabulary.application": ("Request",),
    "automcm_spec.vocabulary.messages": ("Session", "Trajectory"),
    "automcm_spec.vocabulary.parameters": ("Parameters",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Advertised",
    "AgreedManeuver",
    "Application",
    "AsyncioClock",
    "Channel",
    "Choice",
    "Kinematics",
    "Link",
    "McService",
    "Parameters",
    "Proposal",
    "Radio",
    "Request",
    "Service",
    "Session",
    "Station",
    "Trajectory",
    "UdpLink",
    "VirtualClock",
    "__version__",
    "messages",
    "open_log",
]


def __getattr__(name: str) -> Any:
    """One of ``__all__``, from its module.  Raises AttributeError for another name."""
    if name == "__version__":
        return import_module("importlib.metadata").version("automcm")
    if name == "messages":
        return import_module("automcm_spec.vocabulary.messages")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    """The promised names."""
    return __all__

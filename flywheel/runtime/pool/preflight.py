"""What can be known before anything starts: whether a cluster is there, and large enough."""

from __future__ import annotations

import socket
from collections.abc import Iterable

from flywheel.errors import ConfigError
from flywheel.runtime.pool.jobs import Group

_HEADER = ("workers", "count", "CPUs", "GPUs")


def check_fits(groups: Iterable[Group], there: dict[str, float]) -> None:
    """Compare what the groups book with the resources `there`, e.g. {"CPU": 2.0}.

    Raises:
      ConfigError: too little of anything; the message holds a table.
    """
    groups = list(groups)
    rows = [
        (
            group.name,
            str(group.count),
            f"{group.cpus * group.count:g}",
            f"{group.gpus * group.count:g}",
        )
        for group in groups
    ]
    cpus = sum(group.cpus * group.count for group in groups)
    gpus = sum(group.gpus * group.count for group in groups)
    has = (there.get("CPU", 0.0), there.get("GPU", 0.0))
    if cpus <= has[0] and gpus <= has[1]:
        return
    rows += [("wanted", "", f"{cpus:g}", f"{gpus:g}"), ("there", "", f"{has[0]:g}", f"{has[1]:g}")]
    table = "\n".join(f"  {a:<10}{b:>8}{c:>8}{d:>8}" for a, b, c, d in [_HEADER, *rows])
    raise ConfigError(
        "The cluster is too small for the workers that the configuration asks for:\n"
        f"{table}\nAsk for fewer (workers.sim=...), or give the cluster more."
    )


def check_reachable(address: str, seconds: float = 5.0) -> None:
    """Ray itself would try for minutes.

    Raises:
      ConfigError: not an address that can be used.
      ConnectionError: nobody listens there.
    """
    if address in ("auto", "local"):
        return
    host, _, port = address.rpartition(":")
    if "//" in address or not host or not port.isdigit():
        raise ConfigError(
            f"The address of a cluster is host:port (of its head, usually port 6379) or auto, got "
            f"{address!r}. From outside the cluster, use `ray job submit`."
        )
    try:
        socket.create_connection((host, int(port)), timeout=seconds).close()
    except OSError as error:
        raise ConnectionError(f"{error}.") from None

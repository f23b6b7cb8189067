"""A whole site whose broker is a cluster of NATS nodes."""

import asyncio
from dataclasses import dataclass, field

from tests.support.clustered_brokers.nats import NatsNodes
from tests.support.sessions.site import Site


@dataclass
class ClusterSite(Site):
    """A site whose broker is a cluster, with the users that our own command writes."""

    cluster: NatsNodes = field(kw_only=True)

    @property
    def mqtt_url(self):
        return self.cluster.urls

    def write_users(self):
        command = ["mosquitto_files", str(self.cluster.directory), "--engine", "nats"]
        self.run("manage.py", *command)

    def _begin_broker(self):
        self.cluster.start()
        asyncio.run(self.cluster.ready())

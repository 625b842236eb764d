"""ROS 2 on the wire without ROS: topics by Cyclone DDS, with the names and types that ROS 2 gives them.

The only module that uses `cyclonedds`. It learns each type from the message store, for discovery; the bytes of messages
are the store's own.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Collection, Mapping
from functools import cache
from typing import Any, cast
from xml.sax.saxutils import quoteattr

from sqrp_cli.errors import bad_input, needed
from sqrp_cli.ros.messages import Inbox, Message, MessageTypes, Send, Topic, message_types

_PEERS = 40  # Most participants on this computer, where multicast is off
_TAKEN = 64  # Most messages that are taken from a reader at a time


class DdsTransport:
    """Topics of a domain of ROS 2."""

    def __init__(self, domain: int, network: str | None = None) -> None:
        """network: the address or the name of the network interface to use alone; by default as CYCLONEDDS_URI says.

        Raises InputError where cyclonedds is not installed or cannot use the network.
        """
        with needed("ROS 2 on the wire needs the packages cyclonedds and rosbags", "pip install 'sqrp[ros2]'"):
            from cyclonedds.core import DDSException, GuardCondition, WaitSet
            from cyclonedds.domain import Domain, DomainParticipant
        self.types: MessageTypes = message_types(2)
        try:
            if network is not None and domain not in _DOMAINS:
                # This interface alone; without multicast where that is this computer's own.
                kind = "address" if network[:1].isdigit() or ":" in network else "name"
                general, discovery = f"<Interfaces><NetworkInterface {kind}={quoteattr(network)}/></Interfaces>", ""
                if network in ("lo", "::1") or network.startswith("127."):
                    general += "<AllowMulticast>false</AllowMulticast>"
                    discovery = f"<MaxAutoParticipantIndex>{_PEERS}</MaxAutoParticipantIndex>"
                    discovery += "<ParticipantIndex>auto</ParticipantIndex>"
                    discovery += '<Peers><Peer address="127.0.0.1"/></Peers>'
                within = f"<General>{general}</General><Discovery>{discovery}</Discovery>"
                within += "<Internal><SocketReceiveBufferSize min='default'/></Internal>"
                _DOMAINS[domain] = Domain(domain, f"<CycloneDDS><Domain>{within}</Domain></CycloneDDS>")
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            message = f"cannot use domain {domain} of DDS on {network or 'the network'}: {error}"
            raise bad_input("no-network", message) from error
        self._waitset = WaitSet(self._participant)
        self._wake = GuardCondition(self._participant)
        self._waitset.attach(self._wake)
        self._readers: list[tuple[Any, Inbox]] = []
        self._writers: dict[str, Any] = {}
        self._heard = threading.Event()
        self._publications: Any = None
        self._endpoints: dict[Any, Any] = {}
        self._ended = False
        self._thread = threading.Thread(target=self._receive, name="dds", daemon=True)
        self._thread.start()

    def publish(self, topic: Topic) -> Send:
        """Announce a topic; returns what sends on it."""
        from cyclonedds.pub import DataWriter

        made, qos, carrier = self._topic(topic)
        writer = DataWriter(self._participant, made, qos=qos)
        self._writers[topic.name] = writer

        def send(message: Message) -> None:
            writer.write(carrier(self.types.encode(message)))

        return send

    def subscribe(self, topic: Topic) -> Inbox:
        """Read a topic from now on."""
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.sub import DataReader

        made, qos, _ = self._topic(topic)
        reader = DataReader(self._participant, made, qos=qos)
        inbox = Inbox(topic, self.types, self._heard.set)
        self._readers.append((reader, inbox))
        self._waitset.attach(ReadCondition(reader, ViewState.Any | InstanceState.Any | SampleState.NotRead))
        self._wake.set(True)
        return inbox

    def readers(self, topic: Topic) -> int:
        """How many read a topic that is published here."""
        return int(self._writers[topic.name].get_publication_matched_status().current_count)

    def senders(self) -> Mapping[str, Collection[str]]:
        """The types that others send, by the full name of their topic, as far as is known."""
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication

        if self._publications is None:
            self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
            time.sleep(0.05)
        for found in self._publications.take(1000):
            if found.sample_info.valid_data:
                self._endpoints[str(found.key)] = found
            else:
                self._endpoints.pop(str(found.key), None)
        types: dict[str, set[str]] = {}
        for one in self._endpoints.values():
            if one.topic_name.startswith("rt/") and one.participant_key != self._participant.guid:
                name = one.type_name.replace("::dds_::", "::").removesuffix("_").replace("::", "/")
                types.setdefault(one.topic_name.removeprefix("rt"), set()).add(name)
        return types

    def wait(self, seconds: float) -> None:
        """Wait until a message comes, at most for some time [s]."""
        self._heard.wait(seconds)
        self._heard.clear()

    def close(self) -> None:
        """End it; nothing is sent any more."""
        self._ended = True
        self._wake.set(True)
        self._thread.join(2.0)
        self._participant.__del__()

    def _topic(self, topic: Topic) -> tuple[Any, Any, Any]:
        """A topic for DDS, its qualities of service, and the class of its messages, which holds their bytes."""
        from cyclonedds.core import Policy, Qos
        from cyclonedds.topic import Topic as DdsTopic
        from cyclonedds.util import duration

        # The library learns from the class what the messages are, and takes and gives bytes; one of its own, as it is
        # changed.
        carrier = _struct.__wrapped__(topic.type, self.types)
        carrier.__init__ = lambda carrying, data=b"": carrying.__dict__.update(data=bytes(data))
        carrier.serialize, carrier.deserialize = (
            lambda carrying, **_: carrying.data,
            classmethod(lambda made, data, **_: made(data)),
        )
        carrier.deserialize_key = classmethod(lambda *_, **__: None)
        reliable, best = Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.Reliability.BestEffort
        qos = Qos(
            reliable if topic.reliable else best,
            Policy.History.KeepLast(topic.depth),
            Policy.Durability.TransientLocal if topic.latched else Policy.Durability.Volatile,
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        return DdsTopic(self._participant, f"rt/{topic.name.lstrip('/')}", carrier), qos, carrier

    def _receive(self) -> None:
        """Bring what comes to the inboxes, until the end."""
        while not self._ended:
            self._waitset.wait(timeout=500_000_000)
            self._wake.set(False)
            for reader, inbox in tuple(self._readers):
                for sample in reader.take(_TAKEN):
                    data = getattr(sample, "data", None)
                    if data is not None:  # else it says that a sender has gone
                        inbox.put(data)


_DOMAINS: dict[int, Any] = {}  # A process sets up each domain once


@cache
def _struct(name: str, types: MessageTypes) -> Any:  # noqa: ANN401 # a class made at run time
    """The class of a type for DDS, field by field from the message store."""
    import cyclonedds.idl.types
    from cyclonedds.idl import make_idl_struct
    from rosbags.interfaces import Nodetype

    idl: Any = cyclonedds.idl.types
    package, _, short = name.split("/")
    fields = {}
    for field, of in types.store.fielddefs[name][1]:
        kind, about = cast("tuple[Nodetype, Any]", of)
        is_one = kind in (Nodetype.NAME, Nodetype.BASE)
        (inner, what), length = ((kind, about), 1) if is_one else about
        if inner == Nodetype.NAME:
            element = _struct(what, types)
        else:
            element = {"bool": bool, "string": str}.get(what[0]) or getattr(idl, what[0])
        many = idl.array[element, length] if kind == Nodetype.ARRAY else idl.sequence[element]
        fields[field] = element if is_one else many
    return make_idl_struct(f"{short}_", f"{package}.msg.dds_.{short}_", fields, dataclassify=False)

"""
A client of the node that shares no code with ROS: rosless or cyclonedds.

    python test/ros/foreign_client.py rosless IN.npz OUT.npz

Publishes the arrays `reference` (latched) and `live` of IN.npz, mono8, until every output of the
node has come for one and the same stamp. OUT.npz receives that stamp and, by output, the bytes of
its data and its header. Exit code: 0 all came, 1 something did not.
"""

import argparse
import json
import os
import sys
import time

import numpy as np

IMAGES = ('registered', 'rectified', 'change_mask', 'valid_mask', 'residual', 'overlay')
STAMP_S, FRAME = 1_700_000_900, 'foreign'
ANSWER_S = 90.0
AGAIN_S = 1.0  # between two frames
POLL_S = 0.02


class Rosless:
    """Publishers and readers of rosless."""

    def __init__(self, domain):
        import rosless

        self._rosless, self._domain = rosless, domain
        self._readers = {}

    def writer(self, topic, latched):
        """Return a function that publishes an Image given as nested dictionaries."""
        durability = 'transient_local' if latched else 'volatile'
        made = self._rosless.advertise(
            topic, 'sensor_msgs/msg/Image', domain=self._domain, durability=durability
        )
        return made.send

    def read(self, topic, type_name):
        """Listen to a topic."""
        self._readers[topic] = self._rosless.subscribe(
            topic, domain=self._domain, wait=0.0, type_name=type_name, reliability='reliable'
        )

    def take(self, topic):
        """Return a message that has come, or None."""
        return self._readers[topic].read(timeout=0.0)


class Cyclone:
    """Publishers and readers of Eclipse Cyclone DDS, with the names ROS gives types and topics."""

    def __init__(self, domain):
        # Where discovery is for this host only, nobody answers to multicast.
        os.environ.setdefault(
            'CYCLONEDDS_URI',
            '<General><AllowMulticast>false</AllowMulticast></General><Discovery>'
            '<ParticipantIndex>auto</ParticipantIndex>'
            '<MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>'
            '<Peers><Peer address="127.0.0.1"/></Peers></Discovery>',
        )
        import foreign_types
        from cyclonedds.core import Policy, Qos
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.util import duration

        self._types = foreign_types
        self._participant = DomainParticipant(domain)
        self._readers = {}
        common = (
            Policy.Reliability.Reliable(duration(seconds=1)),
            Policy.History.KeepLast(10),
            Policy.DataRepresentation(use_cdrv0_representation=True),
        )
        self._volatile = Qos(*common, Policy.Durability.Volatile)
        self._latched = Qos(*common, Policy.Durability.TransientLocal)

    def _topic(self, topic, kind, qos):
        from cyclonedds.topic import Topic

        return Topic(self._participant, f'rt{topic}', kind, qos=qos)

    def writer(self, topic, latched):
        """Return a function that publishes an Image given as nested dictionaries."""
        from cyclonedds.pub import DataWriter

        qos = self._latched if latched else self._volatile
        made = DataWriter(self._participant, self._topic(topic, self._types.Image, qos), qos=qos)
        return lambda fields: made.write(self._types.image(fields))

    def read(self, topic, type_name):
        """Listen to a topic."""
        from cyclonedds.sub import DataReader

        kind = self._types.BY_NAME[type_name]
        self._readers[topic] = DataReader(
            self._participant, self._topic(topic, kind, self._volatile), qos=self._volatile
        )

    def take(self, topic):
        """Return a message that has come, or None."""
        samples = self._readers[topic].take(N=1)
        return samples[0] if samples else None


def image_fields(array, sec):
    """Return an Image as nested dictionaries."""
    return {
        'header': {'stamp': {'sec': sec, 'nanosec': 0}, 'frame_id': FRAME},
        'height': array.shape[0],
        'width': array.shape[1],
        'encoding': 'mono8',
        'is_bigendian': 0,
        'step': array.shape[1],
        'data': array.tobytes(),
    }


def collect(client, reference, live):
    """Publish until the outputs of one frame are complete; return its stamp and them."""
    types = dict.fromkeys(IMAGES, 'sensor_msgs/msg/Image')
    types |= {'regions_json': 'std_msgs/msg/String'}
    for name, kind in types.items():
        client.read(f'/rsmb/{name}', kind)
    send_reference, send_live = (
        client.writer('/reference/image', True),
        client.writer('/image', False),
    )
    send_reference(image_fields(reference, STAMP_S))
    got = {}  # second of the stamp -> output -> message
    sec, deadline, next_frame = STAMP_S, time.monotonic() + ANSWER_S, 0.0
    while time.monotonic() < deadline:
        if time.monotonic() >= next_frame:
            sec += 1
            send_live(image_fields(live, sec))
            next_frame = time.monotonic() + AGAIN_S
        for name in types:
            while (msg := client.take(f'/rsmb/{name}')) is not None:
                stamp = json.loads(msg.data)['stamp'] if name == 'regions_json' else None
                of = stamp['sec'] if stamp else msg.header.stamp.sec
                got.setdefault(of, {})[name] = msg
        for of, messages in got.items():
            if messages.keys() == types.keys():
                return of, messages
        time.sleep(POLL_S)
    seen = {of: sorted(messages) for of, messages in got.items()}
    raise TimeoutError(f'no complete set of outputs in {ANSWER_S:g} s; by stamp: {seen}')


def main():
    """Parse, collect, save."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('client', choices=('rosless', 'cyclonedds'))
    parser.add_argument('given')
    parser.add_argument('received')
    options = parser.parse_args()
    domain = int(os.environ.get('ROS_DOMAIN_ID', 0))
    client = (Rosless if options.client == 'rosless' else Cyclone)(domain)
    with np.load(options.given) as given:
        try:
            sec, messages = collect(client, given['reference'], given['live'])
        except TimeoutError as error:
            print(error, file=sys.stderr)
            return 1
    arrays = {'sec': np.array(sec)}
    for name, msg in messages.items():
        data = msg.data.encode() if isinstance(msg.data, str) else bytes(msg.data)
        arrays[name] = np.frombuffer(data, np.uint8)
        if name in IMAGES:
            about = (msg.header.frame_id, msg.encoding, msg.height, msg.width, msg.step)
            arrays[f'{name} about'] = np.array(json.dumps(about))
    np.savez(options.received, **arrays)
    return 0


if __name__ == '__main__':
    sys.exit(main())

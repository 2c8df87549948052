"""One bag in every container and compression there is."""

from pathlib import Path

import yaml
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.convert.converter import convert
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from rsmb_ros.bags.writing import BagWriter

_MCAP = {'none': CompressionType.NONE, 'lz4': CompressionType.LZ4, 'zstd': CompressionType.ZSTD}
KINDS = (
    *(f'mcap {name}' for name in (*_MCAP, 'unchunked', 'without index', 'small chunks')),
    'mcap without crc',
    *('folder mcap', 'folder mcap message zstd', 'folder mcap file zstd', 'folder mcap storage'),
    *('db3', 'folder db3', 'folder db3 message zstd', 'folder db3 file zstd', 'folder db3 split'),
    *('folder mcap split', 'folder mcap split without metadata'),
    *('bag', 'bag bz2', 'bag lz4'),
)


def in_container(source: Path, kind: str, folder: Path) -> Path:
    """Write the ROS 2 bag `source` anew; returns the path to open."""
    words = kind.split()
    if words[0] == 'mcap':
        return _mcap(source, ' '.join(words[1:]), folder / 'one.mcap')
    if words[0] == 'bag':
        return _ros1(source, words[1:], folder / 'one.bag')
    if 'split' in words:
        return _split(source, words[1], folder / 'split', 'without' not in words)
    target = folder / 'one'
    storage = 'sqlite3' if 'db3' in words else 'mcap'
    mode = next((mode for mode in ('message', 'file', 'storage') if mode in words), 'none')
    _convert(source, target, storage, None if mode == 'none' else 'zstd', mode)
    return next(target.glob('*.db3')) if words[0] == 'db3' else target


def _convert(source, target, storage='', compress=None, mode='file', **chosen):
    types = get_typestore(Stores.ROS1_NOETIC if target.suffix == '.bag' else Stores.ROS2_JAZZY)
    convert([source], target, storage, 9, compress, mode, types, types, [], [], [], [])


def _ros1(source, words, target):
    _convert(source, target, compress=words[0] if words else None)
    return target


def _messages(source):
    with AnyReader([source]) as reader:
        yield from reader.messages()


def _mcap(source, how, target):
    with target.open('wb') as stream:
        writer = Writer(
            stream,
            compression=_MCAP.get(how, CompressionType.ZSTD),
            use_chunking=how != 'unchunked',
            chunk_size=60_000 if how in ('small chunks', 'without crc') else 1 << 20,
            use_statistics=how != 'without index',
            use_summary_offsets=how != 'without index',
            repeat_channels=how != 'without index',
            repeat_schemas=how != 'without index',
            enable_data_crcs=how == 'unchunked',
            enable_crcs=how != 'without crc',
            **({'index_types': IndexType.METADATA} if how == 'without index' else {}),
        )
        writer.start(profile='ros2', library='test')
        channels = {}
        for connection, time_ns, data in _messages(source):
            if connection.topic not in channels:
                schema = writer.register_schema(
                    connection.msgtype, 'ros2msg', connection.msgdef.data.encode()
                )
                channels[connection.topic] = writer.register_channel(
                    connection.topic, 'cdr', schema
                )
            writer.add_message(channels[connection.topic], time_ns, bytes(data), time_ns)
        writer.finish()
    return target


def _split(source, storage, folder, metadata):
    """Write a recording in two files; the name of the first one sorts after the second's."""
    messages = list(_messages(source))
    half = len(messages) // 2
    parts = []
    for name, part in (('split_9', messages[:half]), ('split_10', messages[half:])):
        whole = folder.parent / f'{name}.mcap'
        with BagWriter(whole) as writer:
            for connection, time_ns, data in part:
                writer.write_cdr(connection.topic, connection.msgtype, bytes(data), time_ns)
        target = folder.parent / f'half_{name}'
        _convert(whole, target, 'sqlite3' if storage == 'db3' else 'mcap')
        parts.append((name, target))
    folder.mkdir()
    told = []
    for name, target in parts:
        (file,) = target.glob(f'*.{storage}')
        file.rename(folder / f'{name}.{storage}')
        told.append(yaml.safe_load((target / 'metadata.yaml').read_text()))
    if metadata:
        information = told[1]['rosbag2_bagfile_information']
        first = told[0]['rosbag2_bagfile_information']
        information['relative_file_paths'] = [f'{name}.{storage}' for name, _ in parts]
        information['message_count'] += first['message_count']
        begin, end = (
            one['starting_time']['nanoseconds_since_epoch'] for one in (first, information)
        )
        information['duration']['nanoseconds'] += end - begin
        information['starting_time'] = first['starting_time']
        # every topic is in one half at least
        topics = {
            one['topic_metadata']['name']: one
            for one in [
                *first['topics_with_message_count'],
                *information['topics_with_message_count'],
            ]
        }
        information['topics_with_message_count'] = list(topics.values())
        (folder / 'metadata.yaml').write_text(yaml.safe_dump(told[1]))
    return folder

"""Which topic is replayed, and what it is compared with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rsmb_ros.bags.image_files import read_image
from rsmb_ros.bags.reading import Bag, Topic
from rsmb_ros.core.errors import BagError, ConfigError


def choose(bag: Bag, named: str | None, topic: str | None) -> tuple[Topic, np.ndarray | Topic]:
    """
    Return the live topic, and the reference or its topic.

    Parameters
    ----------
    bag : Bag
    named : str, optional
        The reference: an image file or a topic; None: the topic that is named as one.
    topic : str, optional
        The live images; None: the only topic it may be.

    """
    reference: np.ndarray | Topic
    if named and Path(named).is_file():
        reference = read_image(Path(named))
    elif named:
        try:
            reference = bag.image_topic(named)
        except BagError as error:
            raise BagError(f'--reference {named} is neither a file nor a topic: {error}') from error
    else:
        reference = bag.guess_reference()
    taken = reference.name if isinstance(reference, Topic) else None
    live = bag.image_topic(topic) if topic else bag.guess_live(taken)
    if live.name == taken:
        raise ConfigError(f'--topic and --reference are both {taken}; must be two topics')
    return live, reference

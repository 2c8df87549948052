"""Publishers and subscriptions whose QoS the user may override, checked before any exists."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSPublisherMatchedInfo,
    SubscriptionEventCallbacks,
    UnsupportedEventTypeError,
)
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from rsmb_ros.core.errors import ConfigError

LATCHED = 'latched'
_POLICIES: dict[str, tuple[str, ...] | None] = {
    'history': ('keep_last', 'keep_all', 'system_default'),
    'depth': None,  # any whole number from 0
    'reliability': ('reliable', 'best_effort', 'system_default'),
}


class Audience:
    """Whether somebody subscribes to a topic, as the middleware's events tell it."""

    def __init__(self) -> None:
        self.present = False

    def matched(self, info: QoSPublisherMatchedInfo) -> None:
        """Take the event of a subscription that came or went; in the executor's thread."""
        self.present = info.current_count > 0


def publisher(
    node: Node, message_class: type, topic: str, depth: int, audience: Audience | None = None
) -> Any:
    """Create a reliable publisher that keeps `depth` messages and tells its audience, if given."""
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)

    def create(events: PublisherEventCallbacks) -> Any:
        return node.create_publisher(
            message_class,
            topic,
            qos,
            event_callbacks=events,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def create_for_audience() -> Any:
        if audience is not None:
            try:
                return create(PublisherEventCallbacks(matched=audience.matched))
            except UnsupportedEventTypeError:  # of a middleware that knows no such event
                audience.present = True  # perhaps
        return create(PublisherEventCallbacks())

    return _with_qos(topic, create_for_audience)


def subscription(
    node: Node,
    message_class: type,
    topic: str,
    callback: Callable[[Any], None],
    entity: str | None = None,
) -> Any:
    """Subscribe with sensor-data QoS, newest message only; or, named 'latched', latched."""
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = entity == LATCHED
    if latched:
        qos.reliability = ReliabilityPolicy.RELIABLE
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    # rclpy would warn of publishers the latched one cannot match; its volatile twin does.
    events = SubscriptionEventCallbacks(use_default_callbacks=not latched)
    overrides = QoSOverridingOptions.with_default_policies(entity_id=entity)
    return _with_qos(
        topic,
        lambda: node.create_subscription(
            message_class,
            topic,
            callback,
            qos,
            event_callbacks=events,
            qos_overriding_options=overrides,
        ),
    )


def check_qos_override(topic: str, policy: str, value: Any) -> None:
    """
    Refuse what an endpoint of `topic` could not be created with.

    Endpoints come and go with the node's state; a wrong setting has to be told at the start.

    Raises
    ------
    ConfigError
        If the policy is none that can be overridden, or its value not allowed.

    """
    if policy not in _POLICIES:
        raise ConfigError(
            f'qos_overrides of {topic}: policy {policy!r} cannot be overridden, '
            f'must be one of {", ".join(_POLICIES)}'
        )
    choices = _POLICIES[policy]
    if choices is None:
        good = type(value) is int and value >= 0
        allowed = 'a whole number from 0'
    else:
        good = isinstance(value, str) and value.lower() in choices
        allowed = f'one of {", ".join(choices)}'
    if not good:
        raise ConfigError(
            f'qos_overrides of {topic} cannot be used: {policy} = {value!r}, must be {allowed}'
        )


def _with_qos(topic: str, create: Callable[[], Any]) -> Any:
    """Create an endpoint; a QoS override that rclpy cannot use is a wrong setting."""
    try:
        return create()
    except (InvalidQosOverridesError, RuntimeError, AssertionError, ValueError) as error:
        reason = str(error) or 'wrong type'
        raise ConfigError(f'qos_overrides of {topic} cannot be used: {reason}') from error

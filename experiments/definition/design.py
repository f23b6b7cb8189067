"""The factors of a study, their levels, and what levels set in the conditions."""

from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from robots.api.floorplan import Key as PlanKey
from robots.api.messages import AssistLevel, Positive, Share
from surveys.documents import DocumentPart, Key, Text

Design = Literal["between", "within"]
Levels = dict[Key, Key]  # of a condition: the key of its level, by the key of the factor
Controller = Literal["keyboard", "mouse", "touch", "stick", "gamepad"]
OwnAction = Literal["places", "map", "follow", "dock", "undock", "tilt"]
ControlWay = Literal["any", "datachannel", "mqtt"]
Delay = Annotated[float, Meta(ge=0.0, le=10.0)]


class TitledPart(DocumentPart, frozen=True, kw_only=True):
    key: Key
    title: Text


class LevelSettings(DocumentPart, frozen=True, kw_only=True):
    """The settings of a level, for each condition that has it; None leaves a setting to the
    condition. Delays and jitters in s, losses as shares of the packets, speed limits in m/s and
    rad/s.
    """

    video_delay: Delay | None = None
    video_jitter: Delay | None = None
    video_loss: Share | None = None
    control_delay: Delay | None = None
    control_jitter: Delay | None = None
    control_loss: Share | None = None
    assist: AssistLevel | None = None
    interface: Key | None = None
    controllers: tuple[Controller, ...] | None = None
    actions: tuple[OwnAction, ...] | None = None
    control_way: ControlWay | None = None
    linear: Positive | None = None
    angular: Positive | None = None
    doors_closed: tuple[PlanKey, ...] | None = None
    robot: PlanKey | None = None
    site: PlanKey | None = None


if TYPE_CHECKING:
    Setting = str
else:
    Setting = Literal[LevelSettings.__struct_fields__]


class Level(TitledPart, frozen=True, kw_only=True):
    sets: LevelSettings = LevelSettings()


class Factor(TitledPart, frozen=True, kw_only=True):
    """A property that a study varies. A participant has all levels of a `within` factor and one of
    a `between` factor; a study with both has a mixed design. Each level sets what the factor
    `changes`: nothing if levels differ in instructions only. The first level is the reference of
    treatment coding.
    """

    design: Design = "between"
    changes: tuple[Setting, ...] = ()
    levels: Annotated[tuple[Level, ...], Meta(max_length=24)] = ()

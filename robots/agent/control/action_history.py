"""What became of each action: asked for twice it is done once, and what has ended stays ended."""

from collections import OrderedDict

from robots.api.messages import ENDED, ActionStatus

KEPT = 1000


class ActionHistory:
    """The last status of the newest actions, by id."""

    def __init__(self) -> None:
        self._statuses: OrderedDict[str, ActionStatus] = OrderedDict()

    def of(self, action_id: str) -> ActionStatus | None:
        """Return the last status of an action that was begun, or None."""
        return self._statuses.get(action_id)

    def record(self, status: ActionStatus) -> bool:
        """Take a status; return False when the action had ended before, and this is nothing new."""
        last = self._statuses.get(status.action_id)
        if last is not None and last.status in ENDED:
            return False
        self._statuses[status.action_id] = status
        while len(self._statuses) > KEPT:
            self._statuses.popitem(last=False)
        return True

    def runs(self, action_id: str) -> bool:
        """Tell whether an action was begun and has not ended."""
        last = self._statuses.get(action_id)
        return last is not None and last.status not in ENDED

"""A bus without ROS, which records messages, calls and orders to the guard."""


class FakeBus:
    place = "a fake bus"
    answers = True
    advice = ""
    connect_time = None
    problems = ()

    def __init__(self, version=1, *, guards=False):
        self.version, self.guards = version, guards
        self.published, self.guard_orders = [], []
        self.calls = []
        self.answer = (True, "")

    def publish(self, topic, message, *, newest=False):
        self.published.append((topic, message))

    def tell_guard(self, **message):
        self.guard_orders.append(message)

    async def call(self, service, kind, arguments=None, *, within=0.0):
        self.calls.append((service, kind, arguments))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    async def cancel_goal(self, action, name):
        return True

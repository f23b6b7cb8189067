"""The agent runs on Windows and on newer Pythons: it calls nothing unguarded that only POSIX has or
that 3.12 and 3.13 removed.

`mypy --platform win32 --python-version 3.13` in `make lint` finds the same from types; this test
takes a second, and also knows which event loop watches foreign sockets, and paths of Linux.
"""

import ast
import sys

import pytest

from tests.support.paths import ROOT
from tests.support.programs.finished import run

SOURCES = [ROOT / "robots" / "__init__.py"] + [
    path
    for folder in ("agent", "api", "world")
    for path in sorted((ROOT / "robots" / folder).rglob("*.py"))
]
ONLY_POSIX = {
    "os": (
        "chown chroot ctermid fchmod fchown fork forkpty geteuid getgid getgroups getloadavg"
        " getpgid getpgrp getpriority getresuid getsid getuid killpg lchown lockf major mkfifo"
        " mknod nice openpty pathconf pipe2 posix_fadvise posix_spawn pread pwrite"
        " sched_getaffinity sched_setaffinity sched_yield sched_setscheduler sendfile setgid"
        " setgroups setpgid setpriority setsid setuid statvfs sync sysconf tcsetpgrp ttyname uname"
        " wait wait3 wait4 waitid"
    ),
    "signal": (
        "SIGALRM SIGCHLD SIGCONT SIGHUP SIGKILL SIGPIPE SIGQUIT SIGSTOP SIGTSTP SIGUSR1 SIGUSR2"
        " SIGWINCH alarm pause pthread_kill pthread_sigmask set_wakeup_fd setitimer sigpending"
        " sigtimedwait sigwait sigwaitinfo"
    ),
    "socket": (
        "AF_UNIX AF_PACKET AF_NETLINK SO_BINDTODEVICE SO_REUSEPORT MSG_DONTWAIT MSG_NOSIGNAL"
        " socketpair_unix recv_fds send_fds"
    ),
    "select": "epoll poll kqueue",
    "time": (
        "CLOCK_BOOTTIME CLOCK_MONOTONIC CLOCK_MONOTONIC_RAW CLOCK_REALTIME clock_gettime"
        " clock_settime tzset"
    ),
    "asyncio": (
        "open_unix_connection start_unix_server create_subprocess_exec create_subprocess_shell"
        " ThreadedChildWatcher get_child_watcher"
    ),
    "multiprocessing": "set_start_method",
}
# Methods of any object: the control loop cannot do these on Windows, where it watches sockets and
# cannot start processes.
OF_ANYTHING = {
    *("add_signal_handler", "create_unix_connection", "create_unix_server"),
    *("connect_read_pipe", "connect_write_pipe", "subprocess_exec", "subprocess_shell"),
}
POSIX_MODULES = {
    *("crypt", "fcntl", "grp", "posix", "pty", "pwd", "resource", "spwd", "syslog", "termios"),
    *("tty", "uvloop"),
}
REMOVED = {  # in 3.12, 3.13
    *("asynchat", "asyncore", "distutils", "imp", "smtpd", "aifc", "audioop", "cgi", "cgitb"),
    *("chunk", "crypt", "imghdr", "lib2to3", "mailcap", "msilib", "nis", "nntplib", "pipes"),
    *("ossaudiodev", "sndhdr", "spwd", "sunau", "telnetlib", "uu", "xdrlib"),
    *("pkg_resources", "setuptools"),
}
# of subprocess
OPTIONS = {"preexec_fn", "pass_fds", "process_group", "umask", "user", "group", "extra_groups"}
PATHS = ("/dev/", "/proc/", "/sys/", "/run/", "/etc/", "/tmp/", "/var/", "/usr/", "/bin/", "/home/")
GUARDS = ("sys.platform", "os.name", "hasattr", "getattr")
EXCUSES = {"NotImplementedError", "AttributeError"}
# Texts for users, and one that is compared with a user's input.
PATHS_IN_WORDS = {"robots/__init__.py", "robots/agent/devices/device_address.py"}


def dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def asks_for_the_system(test: ast.AST) -> bool:
    return any(dotted(node).startswith(GUARDS) for node in ast.walk(test))


def is_excused(handlers: list[ast.ExceptHandler]) -> bool:
    return any(
        dotted(node) in EXCUSES
        for handler in handlers
        if handler.type
        for node in ast.walk(handler.type)
    )


def leaves(body: list[ast.stmt]) -> bool:
    return bool(body) and isinstance(body[-1], ast.Return | ast.Raise | ast.Continue)


class Finder(ast.NodeVisitor):
    """Collects (line, name) of all calls that are not guarded by a check of the system."""

    def __init__(self, *, words: bool = False) -> None:
        self.found: list[tuple[int, str]] = []
        self.guarded = 0
        self.words = words
        self.said: set[int] = set()

    def within_guard(self, nodes) -> None:
        self.guarded += 1
        for node in nodes:
            self.visit(node)
        self.guarded -= 1

    def block(self, body: list[ast.stmt]) -> None:
        """Visit statements in order: code after a return on other systems is guarded."""
        left = 0
        for statement in body:
            self.visit(statement)
            if (
                isinstance(statement, ast.If)
                and asks_for_the_system(statement.test)
                and leaves(statement.body)
            ):
                self.guarded, left = self.guarded + 1, left + 1
        self.guarded -= left

    def generic_visit(self, node: ast.AST) -> None:
        for name, value in ast.iter_fields(node):
            if name in {"body", "orelse", "finalbody"} and isinstance(value, list):
                self.block(value)
            elif isinstance(value, list):
                for one in value:
                    if isinstance(one, ast.AST):
                        self.visit(one)
            elif isinstance(value, ast.AST):
                self.visit(value)

    def visit_If(self, node: ast.If) -> None:
        self.visit(node.test)
        if asks_for_the_system(node.test):
            self.within_guard([*node.body, *node.orelse])
        else:
            self.block(node.body)
            self.block(node.orelse)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        if asks_for_the_system(node.test):
            self.within_guard([node.body, node.orelse])
        else:
            self.generic_visit(node)

    def visit_Try(self, node: ast.Try) -> None:
        if is_excused(node.handlers):
            self.within_guard(node.body)
            for part in (*node.handlers, *node.orelse, *node.finalbody):
                self.visit(part)
        else:
            self.generic_visit(node)

    def visit_Attribute(self, node: ast.Attribute) -> None:
        module, _, name = dotted(node).rpartition(".")
        if node.attr in OF_ANYTHING or name in ONLY_POSIX.get(module, "").split():
            self.add(node, dotted(node) or node.attr)
        self.generic_visit(node)

    def visit_Import(self, node: ast.Import) -> None:
        for alias in node.names:
            self.imported(node, alias.name)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        self.imported(node, node.module or "")
        for alias in node.names:
            if alias.name in ONLY_POSIX.get(node.module or "", "").split():
                self.add(node, f"{node.module}.{alias.name}")

    def imported(self, node: ast.stmt, module: str) -> None:
        if module.partition(".")[0] in POSIX_MODULES | REMOVED:
            self.add(node, module)

    def visit_Call(self, node: ast.Call) -> None:
        module, _, name = dotted(node.func).rpartition(".")
        if module == "subprocess" and name in {"Popen", "run", "call", "check_output"}:
            for keyword in node.keywords:
                if keyword.arg in OPTIONS:
                    self.add(node, f"{keyword.arg}=")
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):  # a docstring opens nothing
            self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, str) and node.value.startswith(PATHS) and not self.words:
            self.add(node, node.value)

    def add(self, node: ast.expr | ast.stmt, what: str) -> None:
        if not self.guarded:
            self.found.append((node.lineno, what))


def problems(source: str, *, words: bool = False) -> list[str]:
    finder = Finder(words=words)
    finder.visit(ast.parse(source))
    return [what for _, what in sorted(finder.found)]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_agent_calls_nothing_that_windows_or_a_newer_python_lacks(path):
    name = path.relative_to(ROOT).as_posix()
    assert problems(path.read_text(encoding="utf-8"), words=name in PATHS_IN_WORDS) == []


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("import os\nos.fork()", ["os.fork"]),
        ("import signal\nend(signal.SIGKILL)", ["signal.SIGKILL"]),
        ("from signal import SIGUSR1", ["signal.SIGUSR1"]),
        ("import fcntl", ["fcntl"]),
        ("import distutils.util", ["distutils.util"]),
        ("import os\nif os.geteuid():\n    pass", ["os.geteuid"]),
        ("import os\nos.killpg(1, 2)", ["os.killpg"]),
        ("import socket\nsocket.socket(socket.AF_UNIX)", ["socket.AF_UNIX"]),
        ("asyncio.open_unix_connection('x')", ["asyncio.open_unix_connection"]),
        ("self.loop().add_signal_handler(2, end)", [".add_signal_handler"]),
        (
            "try:\n    loop.add_signal_handler(2, end)\nexcept ValueError:\n    pass",
            ["loop.add_signal_handler"],
        ),
        ("subprocess.Popen(['x'], preexec_fn=f)", ["preexec_fn="]),
        ("await asyncio.create_subprocess_exec('x')", ["asyncio.create_subprocess_exec"]),
        ("open('/proc/self/stat')", ["/proc/self/stat"]),
        ("import sys\nif sys.flags:\n    open('/dev/null')", ["/dev/null"]),
        ("def f():\n    if sys.platform == 'win32':\n        log()\n    os.nice(1)", ["os.nice"]),
    ],
)
def test_an_unguarded_call_is_found(source, found):
    assert problems(source) == found


@pytest.mark.parametrize(
    "source",
    [
        "try:\n    loop.add_signal_handler(2, end)\nexcept NotImplementedError:\n    pass",
        "if sys.platform.startswith('linux'):\n    os.nice(1)",
        "def f():\n    if sys.platform == 'win32':\n        return\n    os.nice(1)",
        "python = 'python' if sys.platform == 'win32' else '/usr/bin/python3'",
        "if hasattr(signal, 'SIGHUP'):\n    signal.signal(signal.SIGHUP, end)",
        "subprocess.Popen(['x'], start_new_session=True, creationflags=flags)",
        "def f():\n    '''/proc/self is Linux's.'''",
        "import os\nos.replace('a', 'b')",
    ],
)
def test_guarded_or_portable_calls_are_accepted(source):
    assert problems(source) == []


def test_the_control_loop_is_one_that_watches_foreign_sockets_on_windows_too():
    """Unlike the loop of asyncio.run on Windows; the broker's client has its own socket."""
    tree = ast.parse((ROOT / "robots/agent/control/loop.py").read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    loops = [
        keyword.value
        for call in calls
        if dotted(call.func) == "asyncio.Runner"
        for keyword in call.keywords
        if keyword.arg == "loop_factory"
    ]
    assert [dotted(loop) for loop in loops] == ["asyncio.SelectorEventLoop"]
    assert not [call for call in calls if dotted(call.func) == "asyncio.run"]


def test_the_agents_modules_are_written_in_the_grammar_of_the_oldest_python():
    for path in SOURCES:
        ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 11))


def test_the_agent_is_imported_without_a_module_that_windows_lacks():
    # the standard library itself imports these where they exist
    blocked = sorted(POSIX_MODULES - {"posix", "crypt", "spwd", "pwd", "grp", "tty"})
    code = (
        f"import sys; sys.modules.update(dict.fromkeys({blocked!r})); import robots.agent.agent,"
        " robots.agent.adapters.simulator.adapter, robots.agent.adapters.moos.adapter"
    )
    done = run(sys.executable, "-c", code)
    assert done.returncode == 0, done.stderr

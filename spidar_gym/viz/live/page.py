"""The page: viser's panels for a session, with inputs and curves; it stores no state of the robot."""

import math
import queue
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from spidar_gym.envs.registry import CRAWL, GRASP
from spidar_gym.errors import SpidarError
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.tasks.hover import SEQUENCES
from spidar_gym.viz.live.clock import FASTEST, SLOWEST, Clock
from spidar_gym.viz.live.gate import notify
from spidar_gym.viz.live.scenery import SHOWN, Scenery
from spidar_gym.viz.live.session import BY_HAND, INNER, OUTER, Session
from spidar_gym.viz.live.traces import SECONDS, Plot, plots
from spidar_gym.viz.style import BLUE, GREEN, VERMILLION

COLORS = (VERMILLION, GREEN, BLUE)
"""Colours of a plot's curves in their order: x red, y green, z blue."""
MARKS = dict(zip("①②③", FORMS, strict=True))
"""Label of a form's button → its name."""
KEY_STEP, CLICK_STEP = 0.05, 0.1
"""Step of the reference's goal per key press, which repeats while the key is held, and per click [m, rad]."""
MOVES = {
    "↶": {"turn": 1.0}, "↑": {"forward": 1.0}, "↷": {"turn": -1.0},
    "←": {"left": 1.0}, "↓": {"forward": -1.0}, "→": {"left": -1.0},
    "up": {"up": 1.0}, "home": {}, "down": {"up": -1.0},
}  # fmt: skip
"""Button → movement of the reference's goal."""
ROWS = (("↶", "↑", "↷"), ("←", "↓", "→"), ("up", "home", "down"))
KEYS = {"I": "↑", "K": "↓", "J": "←", "L": "→", "U": "↶", "O": "↷", "R": "up", "F": "down", "H": "home"}
"""Key → button. W A S D, Q E and the arrow keys move viser's camera and cannot be reassigned."""
KEY_WORDS = (
    "Keys: **I** **K** forward, back · **J** **L** left, right · **U** **O** turn · **R** **F** up, down · **H** home"
)
NONE = "none"
"""Option for no policy and no lost rotor."""
MOST_WIND, MOST_PUSH, PUSH = 10.0, 60.0, 20.0
"""Largest values of the sliders of wind [m/s] and push [N], and initial value of the push [N]."""
OFTEN, SELDOM = 0.2, 0.5
"""Periods with which the text and the curves are updated [s]."""
Handle = Any
"""viser's handle of an element of the page."""


def _degrees(bounds: tuple[float, float]) -> tuple[float, float]:
    low, high = bounds
    return float(round(math.degrees(low))), float(round(math.degrees(high)))


def _scale(plot: Plot) -> dict[str, Any]:
    """Return the settings of the value axis: it covers the values, but has a least range so that noise stays small."""
    low, bound = (-plot.high, {"pad": 0.1}) if plot.low is None else (plot.low, {"pad": 0.0})
    return {"range": {"min": {**bound, "mode": 1, "soft": low}, "max": {**bound, "mode": 1, "soft": plot.high}}}


class Page:
    """Display of a session and its inputs."""

    def __init__(
        self, server: Handle, trimesh: Any, session: Session, clock: Clock, policies: Mapping[str, str]  # noqa: ANN401
    ) -> None:  # fmt: skip
        """Build the page.

        Args:
            server: viser's server.
            trimesh: The module.
            session: Session of the robot.
            clock: Clock of the session.
            policies: Available policies: name → module:Class or an artifact's path.
        """
        self.session, self.clock, self._server = session, clock, server
        self._policies = {NONE: "", **policies}
        self.scenery = Scenery(server, trimesh, session.ground, session.thing, flies=session.flies)
        self._orders: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._episode: tuple[int, int] | None = None
        self._passed, self._said, self._drawn = -1, -math.inf, -math.inf
        gui = self._gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 94, 150))
        gui.set_panel_label(f"SPIDAR · {session.env_id.rpartition('/')[2]}")
        self._words = gui.add_markdown("")
        self._add_time()
        if session.flies:
            self._add_form()
            self._add_reference()
        elif session.env_id == CRAWL:
            self._add_goal()
        self._add_weather()
        self._add_who()
        self._add_shown()
        gui.main_panel.dock_right()
        self._curves = self._add_curves()
        self._refresh()

    # ---- orders: inputs arrive on threads of the server and are applied between two control periods ----

    def settle(self) -> None:
        """Apply the inputs since the last call; show a notice for each one that is refused."""
        while True:
            try:
                order = self._orders.get_nowait()
            except queue.Empty:
                return
            try:
                order()
            except SpidarError as error:
                self.tell(str(error))
                self._refresh()

    def tell(self, words: str) -> None:
        """Show a notice in every browser for some seconds."""
        for client in self._server.get_clients().values():
            notify(client, words)

    def _on(self, handle: Handle, order: Callable[[Any], object]) -> Handle:
        """Queue an order with the value of an input whenever a user changes it."""

        def changed(event: Any) -> None:  # noqa: ANN401 - viser's event
            if event.client is not None:
                value = event.target.value
                self._orders.put(lambda: order(value))

        (handle.on_update if hasattr(handle, "on_update") else handle.on_click)(changed)
        return handle

    def _slider(
        self, label: str, bounds: tuple[float, float], step: float, value: float, order: Callable[[Any], object],
        hint: str | None = None,
    ) -> Handle:  # fmt: skip
        low, high = bounds
        first = min(max(value, low), high)
        return self._on(
            self._gui.add_slider(label, min=low, max=high, step=step, initial_value=first, hint=hint), order
        )

    def _dropdown(
        self, label: str, options: Iterable[str], value: str, order: Callable[[Any], object], hint: str | None = None
    ) -> Handle:
        return self._on(self._gui.add_dropdown(label, tuple(options), initial_value=value, hint=hint), order)

    def _buttons(self, label: str, names: Iterable[str], order: Callable[[Any], object]) -> Handle:
        return self._on(self._gui.add_button_group(label, tuple(names)), order)

    def _key(self, key: str, label: str, order: Callable[[], object]) -> None:
        self._gui.add_command(label, hotkey=key).on_trigger(lambda _: self._orders.put(order))

    # ---- panels ----

    def _add_time(self) -> None:
        clock, session = self.clock, self.session

        def press(what: str) -> None:
            if what == "pause":
                clock.pause(not clock.is_paused)
            else:
                session.reset(session.seed if what == "again" else None)

        with self._gui.add_folder("Time"):
            self._buttons("episode", ("pause", "again", "next"), press)
            self._slider("speed", (SLOWEST, FASTEST), 0.1, clock.speed, clock.set_speed, "Times real time.")
        self._key("P", "pause or go on", lambda: press("pause"))

    def _add_form(self) -> None:
        session = self.session

        def take(mark: str) -> None:
            session.take_named_form(MARKS[mark])
            self._refresh()

        def bend(_: float) -> None:
            session.take_form(math.radians(self._inner.value), math.radians(self._outer.value))
            self._refresh()

        with self._gui.add_folder("Form"):
            self._buttons("form", MARKS, take)
            self._inner = self._slider("inner pitch [°]", _degrees(INNER), 1.0, 0.0, bend)
            self._outer = self._slider("outer pitch [°]", _degrees(OUTER), 1.0, 0.0, bend)
            self._forms = self._dropdown(
                "sequence", (BY_HAND, *SEQUENCES), session.forms, session.take_forms,
                "Forms that the legs go through automatically.",
            )  # fmt: skip

    def _add_reference(self) -> None:
        session = self.session

        def move(what: str, step: float) -> None:
            if what == "home":
                session.home()
            else:
                session.nudge(**{name: sign * step for name, sign in MOVES[what].items()})

        with self._gui.add_folder("Fly"):
            for row in ROWS:
                self._buttons("", row, lambda what: move(what, CLICK_STEP))
            self._gui.add_markdown(KEY_WORDS)
        for key, what in KEYS.items():
            self._key(key, f"reference {what}", partial(move, what, KEY_STEP))

    def _add_goal(self) -> None:
        gui, session = self._gui, self.session
        with gui.add_folder("Goal"):
            distance = gui.add_slider("distance [m]", min=0.0, max=2.0, step=0.1, initial_value=0.6)
            direction = gui.add_slider("direction [°]", min=-180.0, max=180.0, step=5.0, initial_value=0.0)
            turn = gui.add_slider("turn [°]", min=-90.0, max=90.0, step=5.0, initial_value=0.0)
            self._on(
                gui.add_button("crawl there"),
                lambda _: session.crawl_to(distance.value, math.radians(direction.value), math.radians(turn.value)),
            )

    def _add_weather(self) -> None:
        gui, session, now = self._gui, self.session, self.session.disturbances

        def push(what: str) -> None:
            if what == "once":
                session.shove(force.value, math.radians(self._towards.value))
            else:
                session.disturb(push=force.value if what == "at times" else 0.0)

        with gui.add_folder("Wind, pushes, faults"):
            self._wind = self._slider(
                "wind [m/s]", (0.0, MOST_WIND), 0.5, now.wind,
                lambda value: session.disturb(math.radians(self._towards.value), wind=value),
            )  # fmt: skip
            self._towards = self._slider(
                "wind to [°]", (-180.0, 180.0), 5.0, 0.0, lambda value: session.disturb(math.radians(value)),
                "0 is along x, 90 along y; also the direction of a push.",
            )  # fmt: skip
            force = gui.add_slider(
                "push [N]", min=0.0, max=MOST_PUSH, step=5.0, initial_value=min(now.push, MOST_PUSH) or PUSH,
                hint="For 0.2 s.",
            )  # fmt: skip
            self._buttons("pushes", ("once", "at times", "never"), push)
            self._lost = self._dropdown(
                "lost rotor", (NONE, *map(str, range(1, N_ROTORS + 1))), str(now.lost_rotor or NONE),
                lambda value: session.disturb(lost_rotor=0 if value == NONE else int(value)),
            )  # fmt: skip
            self._fault = self._dropdown("rotor loses", FAULTS, now.fault, lambda value: session.disturb(fault=value))

    def _add_who(self) -> None:
        session = self.session

        def choose(**who: str) -> None:
            session.choose(**who)
            self._refresh()

        with self._gui.add_folder("Controller"):
            self._preset = self._dropdown("preset", session.presets, session.preset, lambda value: choose(preset=value))
            self._policy = self._dropdown(
                "policy", self._policies, self._name_of_policy,
                lambda value: choose(policy=self._policies.get(value, session.policy)),
                "Adds to the preset, or replaces it by another controller.",
            )  # fmt: skip

    def _add_shown(self) -> None:
        gui, scenery = self._gui, self.scenery
        with gui.add_folder("Show", expand_by_default=False):
            for what in SHOWN:
                box = gui.add_checkbox(what, initial_value=True)
                self._on(box, lambda shown, what=what: scenery.hide(what, is_hidden=not shown))
            box = gui.add_checkbox("robot in the middle", initial_value=True)
            self._on(box, lambda value: setattr(scenery, "follows", value))

    def _add_curves(self) -> list[tuple[Handle, int, Plot]]:
        panel, found, first, session = self._gui.add_panel(), list[tuple[Handle, int, Plot]](), 0, self.session
        with panel.add_tab(f"Last {SECONDS:g} s"):
            for plot in plots(session.env_id):
                count, strokes = len(plot.names), zip(plot.names, COLORS, strict=False)
                series = [
                    {"label": "t"},
                    *({"label": name, "stroke": stroke, "width": 1.6} for name, stroke in strokes),
                ]
                handle = self._gui.add_uplot(
                    data=session.traces.columns(first, count), series=tuple(series), title=plot.title, height=160,
                    scales={"x": {"time": False}, "y": _scale(plot)},
                    axes=({"size": 40}, {"size": 44}), legend={"show": True, "live": False}, cursor={"show": False},
                    padding=(8, 16, 0, 0),
                )  # fmt: skip
                found.append((handle, first, plot))
                first += count
        panel.dock_left()
        panel.set_width(300)
        return found

    # ---- what is shown ----

    def show(self, now: float) -> None:
        """Update the page at a wall time [s]; text and curves less often."""
        session, server = self.session, self._server
        if not server.get_clients():
            return
        with server.atomic():
            episode = session.seed, id(session.env)
            if episode != self._episode:
                self._episode = episode
                self.scenery.lay(session.ground, session.thing, session.way, session.goal)
            frame = session.frame
            if session.passed != self._passed and np.isfinite(frame.qpos).all():
                self._passed = session.passed
                self.scenery.show(frame)
            if now - self._said >= OFTEN:
                self._said = now
                self._words.content = self.words()
        if now - self._drawn >= SELDOM:
            self._drawn = now
            for handle, first, plot in self._curves:
                handle.data = session.traces.columns(first, len(plot.names))

    def words(self) -> str:
        """Return the status text: time, whether the machine keeps up, errors."""
        session, clock = self.session, self.clock
        frame, info = session.frame, session.info
        pace = (
            "paused" if clock.is_paused else
            f"**late: {clock.pace:.2f} × real time instead of {clock.speed:g}**, {clock.given_up} periods skipped"
            if clock.is_late else f"{clock.speed:g} × real time"
        )  # fmt: skip
        lines = [f"**{frame.time:.1f} s** · {frame.phase} · {pace}"]
        if frame.over:
            lines = [f"**over: {frame.over}** after {frame.time:.1f} s · the next episode follows"]
        lift = f"{frame.thrust.sum() / ROBOT.weight:.0%} of its weight · {info['power_w']:.0f} W"
        if session.flies:
            position, attitude = (1e3 * np.linalg.norm(info[f"{name}_error"]) for name in ("position", "attitude"))
            lines.append(f"{position:.0f} mm, {attitude:.0f} mrad off")
        else:
            x, y = info["object_error" if session.env_id == GRASP else "goal_error"].tolist()[:2]
            lines.append(f"goal {math.hypot(x, y):.2f} m away")
        return "  \n".join((*lines, lift))

    def _refresh(self) -> None:
        """Set the inputs to the session's present values."""
        session = self.session
        if session.flies:
            inner, outer = (math.degrees(float(session.form[k])) for k in (1, 3))
            self._inner.value, self._outer.value = float(round(inner)), float(round(outer))
            self._forms.value = session.forms
        now = session.disturbances
        self._wind.value, self._towards.value = min(now.wind, MOST_WIND), math.degrees(session.towards)
        self._lost.value, self._fault.value = str(now.lost_rotor or NONE), now.fault
        self._policy.value = self._name_of_policy
        self._preset.disabled, self._preset.value = session.preset_is_the_policys, session.preset

    @property
    def _name_of_policy(self) -> str:
        return next(name for name, spec in self._policies.items() if spec == self.session.policy)

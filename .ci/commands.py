"""Every command of the guide in a short version, run by `.ci/wheel.py --commands` with the wheel alone."""

import shlex
from dataclasses import dataclass

DONE = "done"
"""Outcome of a command that succeeds."""
VIZ, WEB, TUNE, TRAIN, RAY, LOG = "viz", "web", "tune", "train", "ray", "log"
"""Names of the extras."""
CLONE = "valid: a clone of the repository"
"""Part of the refusal of a development command outside a clone."""
MINE = '''
from pathlib import Path
Path("long.toml").write_text("pitch_to_foot = 0.6138")
Path("mine.py").write_text("""
import numpy as np
from spidar_gym.tasks.hover import HoverTask

class Circle(HoverTask):
    def reference(self, robots):
        wanted = super().reference(robots)
        wanted["position_w"][:, 0] += 0.2 * np.sin(robots.time)
        return wanted

class Damper:
    def arguments(self, env_id):
        return {"action_mode": "residual_wrench"} if env_id == "spidar_gym/Hover-v0" else None

    def reset(self, seed):
        pass

    def act(self, observation):
        return np.concatenate([np.zeros(3), 0.25 * observation[9:12]])
""")
'''
LEARN = """
import spidar_gym
from stable_baselines3 import PPO
PPO("MlpPolicy", "spidar_gym/Hover-v0", n_steps=8, batch_size=8).learn(8).save("model.zip")
"""
SERVE = """
import signal, subprocess, sys

def heard():
    signal.signal(signal.SIGINT, signal.SIG_DFL)

serving = subprocess.Popen(["spidar", *sys.argv[1:]], stdout=subprocess.PIPE, text=True, preexec_fn=heard)
if serving.stdout.readline():
    serving.send_signal(signal.SIGINT)
status = serving.wait()
sys.exit(0 if status == 130 else status)
"""
README = """
import gymnasium
import numpy as np
import spidar_gym

# Forms that are drawn at random, reached at 0.6 rad/s; the real robot flew at 0.2.
env = gymnasium.make("spidar_gym/Hover-v0", forms="independent", joint_speed=0.6)
observation, info = env.reset(seed=0)
for _ in range(200):  # a zero action is the paper's controller alone
    observation, reward, terminated, truncated, info = env.step(np.zeros(6))
error = 1000 * np.linalg.norm(info["position_error"])
print(f"reward {reward:.2f}, {error:.1f} mm off, QP {info['qp_status']}")
"""


@dataclass(frozen=True)
class Try:
    """A command of the guide."""

    command: str
    """The command as written in the guide; unique."""
    options: str = ""
    """Additional options for a short run."""
    extra: str = ""
    """The required extra; empty for none."""
    refusal: str = ""
    """Part of the one-line refusal, without the extra if one is required; empty for a command that succeeds."""
    makes: tuple[str, ...] = ()
    """Files that the command must create."""
    instead: str = ""
    """The command line to run in place of `command` with `options`."""
    status: int = 2
    """Exit status of a refusal."""
    alone: bool = True
    """Whether the command also runs without the extra."""

    @property
    def tried(self) -> str:
        """The command line that is run."""
        return self.instead or f"{self.command} {self.options}".strip()

    @property
    def words(self) -> list[str]:
        """The words of the command line that is run."""
        return shlex.split(CODE.get(self.tried, self.tried))


CODE = {
    "python README.py": f"python -W error -c {shlex.quote(README)}",
    "python mine.py": f"python -c {shlex.quote(MINE)}",
    "python serve.py sitl robot --link socket": f"python -c {shlex.quote(SERVE)} sitl robot --link socket",
    "python serve.py view --web --port 0": f"python -c {shlex.quote(SERVE)} view --web --port 0",
    "python learn.py": f"python -c {shlex.quote(LEARN)}",
}
"""Programs that do not exist as files: name → command."""
FAST5 = "--tracks flight-fast5 --scenarios 1"
MEMORY = "baselines/learned/memory/seed0.npz"

GUIDE = (
    Try("ten lines of README", instead="python README.py"),
    Try("spidar --version"),
    Try("spidar list"),
    Try("spidar list ENV_ID", instead="spidar list spidar_gym/Course-v0"),
    Try("a custom policy, task and robot", instead="python mine.py", makes=("mine.py", "long.toml")),
    # Flights and crawls.
    Try("spidar run", "--seconds 1 --forms paper"),
    Try("spidar run ENV_ID", instead="spidar run spidar_gym/Course-v0 --seconds 2"),
    Try("spidar run --sensors --randomization 1 --wind 3 --push 30 --lost-rotor 3", "--seconds 1"),
    Try("spidar run --policy MODULE:CLASS", instead="spidar run --policy baselines.adrc:Adrc --seconds 1"),
    Try("spidar run --policy FILE --against MODULE:CLASS",
        instead=f"spidar run --policy {MEMORY} --against baselines.qp:QP --seconds 1"),
    Try("spidar run --task MODULE:CLASS", instead="spidar run --task mine:Circle --seconds 1"),
    Try("spidar run --robot FILE", instead="spidar run --robot long.toml --seconds 1"),
    Try("spidar run --observation goal", "--seconds 1"),
    Try("spidar run --out FILE.mp4", extra=VIZ, refusal="spidar-gym[viz]", makes=("film.mp4",),
        instead="spidar run --seconds 0.5 --out film.mp4"),
    Try("spidar run --show", refusal="display"),
    Try("PPO of Stable-Baselines3", extra=TRAIN, alone=False, instead="python learn.py", makes=("model.zip",)),
    Try("spidar run --policy FILE.zip --trust", extra=TRAIN, refusal="spidar-gym[train]",
        instead="spidar run --policy model.zip --trust --seconds 0.5"),
    Try("spidar view", refusal="display"),
    Try("spidar view --web, then Ctrl-C", extra=WEB, refusal="spidar-gym[web]",
        instead="python serve.py view --web --port 0"),
    # The paper and the studies.
    Try("spidar paper", instead="spidar paper both --no-video",
        makes=("out/flight/flight.json", "out/crawl/crawl.json")),
    Try("spidar paper flight", "--noise", extra=VIZ, makes=("out/flight/flight.json",)),
    Try("spidar paper flight --speeds", "--scenarios 1"),
    Try("spidar paper flight --ablation", "--scenarios 1"),
    Try("spidar paper crawl", "--overlapped --power --no-video"),
    Try("spidar paper crawl --study", "--seeds 1"),
    Try("spidar paper crawl --draws N", instead="spidar paper crawl --draws 1"),
    Try("python -m spidar_gym.studies lost"),
    Try("python -m spidar_gym.studies hops", "--robots 1"),
    Try("python -m spidar_gym.studies steps", "--gaits robust --seeds 1"),
    Try("python -m spidar_gym.studies ablations", "--scenarios 1"),
    Try("python -m spidar_gym.studies gates", "--seeds 1"),
    # Searches.
    Try("spidar tune flight", "--generations 1 --population 2 --scenarios 1", extra=TUNE, refusal="spidar-gym[tune]"),
    Try("spidar tune crawl", "--generations 1 --population 2 --scenarios 1", extra=TUNE, refusal="spidar-gym[tune]"),
    Try("spidar tune retuned", "--generations 1 --scenarios 1"),
    Try("spidar tune recrawl", "--generations 1 --scenarios 1"),
    Try("spidar tune MODULE:NAME", instead="spidar tune baselines.indi:SEARCH --generations 1 --scenarios 1"),
    # The benchmark.
    Try("spidar eval --policy module:Class", instead=f"spidar eval --policy mine:Damper {FAST5}",
        makes=("out/scores/damper.json",)),
    Try("spidar eval --policy module:Class --split validation",
        instead=f"spidar eval --policy mine:Damper {FAST5} --split validation --out out/validation"),
    Try("spidar eval --policy a.npz b.npz",
        instead=f"spidar eval --policy {MEMORY} {MEMORY.replace('0', '1')} {FAST5}"),
    Try("spidar eval --baselines", "--scenarios 1 --out out/baselines", extra=TUNE, refusal="spidar-gym[tune]",
        makes=("out/baselines/mpc.json",)),
    Try("spidar eval --policy module:Class --ray ADDRESS", extra=RAY, refusal="spidar-gym[ray]",
        instead=f"spidar eval --policy baselines.adrc:Adrc {FAST5} --ray local --workers 1"),
    Try("spidar leaderboard show", "--wide"),
    Try("spidar leaderboard show --rows FOLDER",
        instead="spidar leaderboard show --rows out/scores --tracks flight-fast5 --json"),
    Try("spidar leaderboard compare --row FILE --base NAME",
        instead="spidar leaderboard compare --row baselines/scores/qp_retuned.json --base qp_tuned"),
    Try("spidar leaderboard build", "--out board", makes=("board/LEADERBOARD.md",)),
    Try("spidar leaderboard verify", "--sample 4"),
    Try("spidar leaderboard held-out", "--names memory --scenarios 1"),
    Try("spidar leaderboard held-out --policy FILE --against NAME",
        instead="spidar leaderboard held-out --policy mine:Damper --against qp_tuned --scenarios 1"),
    Try("spidar leaderboard answers", "--names qp --tracks flight-paper --scenarios 1"),
    Try("spidar suite"),
    Try("spidar suite TASK --policy POLICY",
        instead="spidar suite Hover --policy baselines.qp_steady:QPSteady --episodes 2"),
    Try("spidar scenarios --check"),
    # Export and software in the loop.
    Try("spidar export", "--out onboard",
        makes=("onboard/core/flight.c", "onboard/examples/allocate.c", "onboard/MANIFEST.json")),
    Try("spidar export --residual FILE", instead=f"spidar export --out learned --residual {MEMORY}"),
    Try("spidar export --robot FILE", instead="spidar export --out longer --robot long.toml"),
    Try("spidar sitl flight", "--link socket"),
    Try("spidar sitl flight --residual FILE", instead=f"spidar sitl flight --link socket --residual {MEMORY}"),
    Try("spidar sitl crawl", "--link socket"),
    Try("spidar sitl course", "--link socket --robots 1"),
    Try("spidar sitl course --gates N", instead="spidar sitl course --gates 1 --link socket --robots 1"),
    Try("spidar sitl faults", "--link socket --only killed"),
    Try("spidar sitl robot --link socket, then Ctrl-C", instead="python serve.py sitl robot --link socket"),
    # Logs.
    Try("spidar log info FILE", instead="spidar log info out/sitl-flight/run.log"),
    Try("spidar log convert FILE --csv DIR",
        instead="spidar log convert out/sitl-flight/run.log --csv out/csv", makes=("out/csv/imu.csv",)),
    Try("spidar log convert FILE", extra=LOG, refusal="spidar-gym[log]", makes=("out/run.mcap",),
        instead="spidar log convert out/sitl-flight/run.log --out out/run.mcap"),
    Try("spidar run --log FILE.mcap", extra=LOG, refusal="spidar-gym[log]", makes=("episode.mcap",),
        instead="spidar run --seconds 0.5 --log episode.mcap"),
    # From logs to parameters.
    Try("spidar sitl tests", instead="spidar sitl tests --link socket --only thrust --out tests",
        makes=("tests/thrust.log",)),
    Try("spidar identify LOG …", instead="spidar identify tests/thrust.log --mass 16 --out identified/robot.toml",
        makes=("identified/robot.toml", "identified/report.md", "identified/report.json")),
    Try("spidar eval --robots FILE", instead="spidar eval --policy baselines.qp_steady:QPSteady "
        "--tracks flight-calibrated --scenarios 1 --robots identified/robot.toml"),
    Try("spidar parameters --robot FILE", makes=("identified/parameters.txt",),
        instead="spidar parameters --robot identified/robot.toml --presets steady --fragile "
        "--out identified/parameters.txt"),
    # Speed and generated files.
    Try("spidar bench", "--seconds 0.01"),
    Try("spidar assets"),
    Try("spidar assets --check"),
    Try("spidar assets --robot FILE --out FOLDER", instead="spidar assets --robot long.toml --out long"),
    # Commands of the development.
    Try("spidar docs", refusal=CLONE),
    Try("spidar docs --tables", refusal=CLONE),
    Try("spidar docs --pictures", refusal=CLONE),
    Try("python -m train.NAME", refusal="No module named 'train'", status=1, instead="python -m train.distill first"),
)  # fmt: skip
"""All commands, ordered so that each finds the files of earlier ones."""

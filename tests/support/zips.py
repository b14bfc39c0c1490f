"""Zips of Stable-Baselines3: a briefly trained model, and pickles that create a file when they are executed."""

import base64
import io
import json
import pickle
import zipfile
from pathlib import Path


class Trap:
    """An object that creates a file when it is unpickled."""

    def __init__(self, sprung: Path) -> None:
        self.sprung = sprung

    def __reduce__(self):
        return Path.touch, (self.sprung,)


def packed(value: object) -> dict[str, str]:
    """A value as stored in a zip's `data` if it is not JSON."""
    return {":type:": "", ":serialized:": base64.b64encode(pickle.dumps(value)).decode()}


def changed(data: bytes, **entries: object) -> bytes:
    """A zip with changed entries of its `data`."""
    made = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(made, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            new.writestr(name, json.dumps(json.loads(content) | entries) if name == "data" else content)
    return made.getvalue()


def learned(path: Path, env_id: str = "spidar_gym/Hover-v0") -> Path:
    """Save a PPO that was trained for eight ticks; return its path."""
    from stable_baselines3 import PPO  # not installed for every test

    model = PPO("MlpPolicy", env_id, n_steps=8, batch_size=8, n_epochs=1, seed=0, device="cpu")
    model.learn(8)
    model.save(path)
    return path

"""Write motions as a dataset in LeRobot's layout, version 3.0: python examples/lerobot_dataset.py FOLDER FILES.

FILES are trajectories as `jaxik plan` saves them, one per episode. Only pyarrow is needed, not lerobot. A frame's
``observation.state`` holds the joint angles and its ``action`` those of the next frame, in radians, as float32.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import jaxik

DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
NUMBERS = {"timestamp": "float32"} | dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")

_TASKS = [
    {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
    for name, kind, numpy in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
]
_ABOVE = {"name": None, "field_name": None, "pandas_type": "unicode", "numpy_type": "object", "metadata": None}


def write_dataset(
    folder: str | Path, motions: Sequence[jaxik.Trajectory], tasks: Sequence[str], fps: int = 30, robot: str = "arm"
) -> None:
    """Write motions as the episodes of a dataset.

    Args:
        folder: Folder of the dataset; it must not exist, as for LeRobot.
        motions: One per episode, of the same joints.
        tasks: What each does, in words.
        fps: Frames per second.
        robot: Name of the robot.

    Raises:
        ValueError: No motions, other joints, or not one task per motion.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = {motion.joint_names for motion in motions}
    if len(names) != 1 or len(tasks) != len(motions):
        raise ValueError(
            f"expected motions of the same joints and one task each; got {len(motions)} motions of {len(names)} "
            f"kinds of joints and {len(tasks)} tasks"
        )
    (joints,), root, known = names, Path(folder), list(dict.fromkeys(tasks))
    episodes = [_frames(motion, fps) for motion in motions]
    ends = np.cumsum([len(q) for q in episodes]).tolist()
    columns: dict[str, np.ndarray] = {
        "observation.state": np.concatenate(episodes),
        "action": np.concatenate([np.concatenate([q[1:], q[-1:]]) for q in episodes]),
        "timestamp": np.concatenate([np.arange(len(q)) / fps for q in episodes]).astype(np.float32),
        "frame_index": np.concatenate([np.arange(len(q)) for q in episodes]),
        "episode_index": np.repeat(np.arange(len(episodes)), [len(q) for q in episodes]),
        "index": np.arange(ends[-1]),
        "task_index": np.repeat([known.index(task) for task in tasks], [len(q) for q in episodes]),
    }
    rows = [
        {
            "episode_index": i,
            "tasks": [task],
            "length": len(q),
            "dataset_from_index": end - len(q),
            "dataset_to_index": end,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "meta/episodes/chunk_index": 0,
            "meta/episodes/file_index": 0,
        }
        for i, (q, task, end) in enumerate(zip(episodes, tasks, ends, strict=True))
    ]
    lists = {
        name: pa.FixedSizeListArray.from_arrays(pa.array(values.ravel()), len(joints)) if values.ndim == 2 else values
        for name, values in columns.items()
    }
    root.mkdir(parents=True)
    for name in ("meta/episodes/chunk-000", "data/chunk-000"):
        (root / name).mkdir(parents=True)
    pq.write_table(pa.table(lists), root / DATA.format(chunk_index=0, file_index=0))
    pq.write_table(pa.Table.from_pylist(rows), root / EPISODES)
    # LeRobot reads this table by pandas and looks up a task by its place; the words are the index.
    table = pa.table({"task_index": list(range(len(known))), "task": known})
    index = {"index_columns": ["task"], "column_indexes": [_ABOVE], "columns": _TASKS, "pandas_version": "2.0.0"}
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(index)}), root / "meta/tasks.parquet")
    _write_json(root / "meta/stats.json", {name: _statistics(values) for name, values in columns.items()})
    _write_json(root / "meta/info.json", _info(columns, joints, rows, len(known), fps, robot))


def _frames(motion: jaxik.Trajectory, fps: int) -> np.ndarray:
    """Joint angles at whole frames from the start on, ``(frame, joint)`` [rad]."""
    count = int(motion.duration * fps + 1e-6) + 1
    return np.stack([motion.sample(motion.time[0] + i / fps) for i in range(count)]).astype(np.float32)


def _statistics(values: np.ndarray) -> dict[str, list[float]]:
    """Numbers by which LeRobot normalizes a feature."""
    wide = values.astype(np.float64).reshape(len(values), -1)
    found = {"min": wide.min(0), "max": wide.max(0), "mean": wide.mean(0), "std": wide.std(0)}
    return {name: numbers.tolist() for name, numbers in found.items()} | {"count": [len(values)]}


def _info(
    columns: Mapping[str, np.ndarray],
    joints: Sequence[str],
    rows: list[dict[str, Any]],
    tasks: int,
    fps: int,
    robot: str,
) -> dict[str, Any]:
    """Content of ``meta/info.json``."""
    angles = {"dtype": "float32", "shape": [len(joints)], "names": list(joints)}
    features = {
        name: angles if values.ndim == 2 else {"dtype": NUMBERS[name], "shape": [1], "names": None}
        for name, values in columns.items()
    }
    return {
        "codebase_version": "v3.0",
        "robot_type": robot,
        "total_episodes": len(rows),
        "total_frames": len(columns["index"]),
        "total_tasks": tasks,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": fps,
        "splits": {"train": f"0:{len(rows)}"},
        "data_path": DATA,
        "video_path": None,
        "features": features,
    }


def _write_json(file: Path, content: dict[str, Any]) -> None:
    """Write a document as text."""
    file.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")


if __name__ == "__main__":
    files = sys.argv[2:]
    write_dataset(sys.argv[1], [jaxik.load_trajectory(file) for file in files], [Path(file).stem for file in files])

# SPDX-License-Identifier: Apache-2.0
"""Makes the ROS 2 side of the environment: messages, executables, share folder.

Run it with the environment's own Python: `.venv/bin/python tools/setup_ros.py`. It says
what it does, one line a step, and does nothing where nothing changed.

- A path file makes the environment import this very folder: an edit is at work at once.
- `vega_msgs` is built by colcon into the environment itself, whose `lib` folder the ROS 2
  wheels put on the library path: `import vega_msgs` needs no sourcing.
- `share/vega` and `lib/vega` point into this folder, so that `ros2 run`, `ros2 launch` and
  the ament index find the package as they would find one installed by colcon.

With a full ROS 2 sourced, the messages are built against that one.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = Path(sys.prefix)
SITE = Path(sysconfig.get_paths()["purelib"])

#: Folders that share/vega shows.
SHARED = ("config", "launch", "parts", "rviz", "urdf")
#: Executables of lib/vega and the modules they start.
EXECUTABLES = {
    "planner": "vega_planner.nodes.planner",
    "print_job": "vega_planner.nodes.print_job",
    "robot_driver": "vega_robot_driver.nodes.robot_driver",
}
#: Re-executes Python once with the environment's libraries on the library path, as the
#: ROS 2 wheels do for themselves; written where a full ROS 2 takes the wheels' place.
LIBRARY_PATH_HOOK = (
    "import os, sys; lib = os.path.join(sys.prefix, 'lib'); "
    "have = os.environ.get('LD_LIBRARY_PATH', '').split(':'); "
    "lib in have or (os.environ.update(LD_LIBRARY_PATH=':'.join(filter(None, [lib, *have]))), "
    "os.execv(sys.executable, sys.orig_argv))\n"
)


def main() -> int:
    """Bring the environment up to date."""
    if Path(sys.base_prefix) == VENV:
        print(f"setup_ros: {sys.executable} is not in a virtual environment", file=sys.stderr)
        return 2
    full = _full_ros()
    if importlib.util.find_spec("rclpy") is None:
        print(
            "setup_ros: rclpy not found; install the ROS 2 wheels or source ROS 2", file=sys.stderr
        )
        return 2
    steps = (
        ("package", _hash(["tools/setup_ros.py"]), _install_package),
        ("messages", _hash(["vega_msgs", "tools/setup_ros.py"]) + full, lambda: _messages(full)),
        ("share and executables", _hash(["tools/setup_ros.py"]) + _listing(), _share),
    )
    for name, key, step in steps:
        stamp = VENV / "share" / "vega_setup" / name.replace(" ", "_")
        key += f" {ROOT} {sys.version_info[:3]}"
        if stamp.is_file() and stamp.read_text() == key and _present(name):
            print(f"setup_ros: {name}: up to date")
            continue
        print(f"setup_ros: {name}: installing", flush=True)
        stamp.unlink(missing_ok=True)
        step()
        stamp.parent.mkdir(parents=True, exist_ok=True)
        stamp.write_text(key)
    return 0


def _full_ros() -> str:
    """Name the sourced ROS 2 whose rclpy lies outside the environment, or nothing."""
    spec = importlib.util.find_spec("rclpy")
    if os.environ.get("ROS_DISTRO") and spec and spec.origin:
        inside = Path(spec.origin).is_relative_to(VENV)
        return "" if inside else os.environ["ROS_DISTRO"]
    return ""


def _hash(names: list[str]) -> str:
    digest = hashlib.sha256()
    for name in names:
        path = ROOT / name
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for file in files:
            digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def _listing() -> str:
    """Hash the names of the shared files; their content is linked."""
    names = "\n".join(str(path) for path in _shared_files())
    return hashlib.sha256(names.encode()).hexdigest()


def _present(name: str) -> bool:
    """Tell whether what a stamp promises is really there."""
    if name == "messages":
        return (SITE / "vega_msgs").is_dir()
    if name == "package":
        return (VENV / "bin" / "vega").is_file()
    return all((VENV / "lib" / "vega" / item).is_file() for item in EXECUTABLES)


def _run(command: list[str], log: str, **options: object) -> None:
    """Run a command, its output kept in a log that is shown when it fails."""
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options
    )
    folder = VENV / "share" / "vega_setup"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{log}.log").write_text(done.stdout)
    if done.returncode:
        tail = "\n".join(done.stdout.splitlines()[-40:])
        raise SystemExit(f"{tail}\nsetup_ros: {' '.join(command[:4])} ... failed")


def _install_package() -> None:
    (SITE / "vega.pth").write_text(f"{ROOT}\n")
    _script(VENV / "bin" / "vega", "vega_planner.cli")


def _script(path: Path, module: str) -> None:
    """Write an executable that runs a module's main function."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    path.write_text(
        f"#!{sys.executable}\nimport sys\n\nfrom {module} import main\n\n"
        'if __name__ == "__main__":\n    sys.exit(main())\n'
    )
    path.chmod(0o755)


def _messages(full: str) -> None:
    if full:
        (SITE / "vega_library_path.pth").write_text(LIBRARY_PATH_HOOK)
    else:
        _relocate_wheels()
    environment = {
        **os.environ,
        "PATH": f"{VENV / 'bin'}{os.pathsep}{os.environ.get('PATH', '')}",
        "VIRTUAL_ENV": str(VENV),
    }
    for variable in ("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
        others = environment.get(variable, "") if full else ""
        environment[variable] = os.pathsep.join(filter(None, [str(VENV), others]))
    scratch = VENV / "build_vega"
    shutil.rmtree(scratch, ignore_errors=True)
    command = [sys.executable, "-m", "colcon"] if not full else ["colcon"]
    command += [f"--log-base={scratch / 'log'}", "build", f"--base-paths={ROOT / 'vega_msgs'}"]
    command += ["--merge-install", f"--install-base={VENV}", f"--build-base={scratch}"]
    command += ["--event-handlers=console_direct+", "--cmake-args", "-DBUILD_TESTING=OFF"]
    command += ["-DCMAKE_BUILD_TYPE=Release", f"-DPython3_EXECUTABLE={sys.executable}"]
    # One message in three languages is 300 small files: leave out what optimising them costs.
    command += ["-DCMAKE_CXX_FLAGS_RELEASE=-O1", "-DCMAKE_C_FLAGS_RELEASE=-O1"]
    _run(command, "messages", env=environment, cwd=ROOT)
    shutil.rmtree(scratch, ignore_errors=True)


def _relocate_wheels() -> None:
    """Replace the build machine's paths in the wheels' CMake files by the environment's."""
    python = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    tag = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    built = f"/opt/python/{tag}-{tag}"
    changes = (
        (f"{built}/include/{python}".encode(), sysconfig.get_paths()["include"].encode()),
        (built.encode(), str(VENV).encode()),
    )
    for path in (VENV / "share").rglob("*"):
        if path.suffix not in (".cmake", ".in", ".sh", ".dsv", ".json", ".txt", ".py", ""):
            continue
        if not path.is_file():
            continue
        old = text = path.read_bytes()
        for was, now in changes:
            text = text.replace(was, now)
        if text != old:
            path.write_bytes(text)


def _shared_files() -> list[Path]:
    files = [ROOT / "package.xml"]
    for name in SHARED:
        found = (path for path in (ROOT / name).rglob("*") if path.is_file())
        files += sorted(path for path in found if "__pycache__" not in path.parts)
    return files


def _share() -> None:
    share = VENV / "share" / "vega"
    share.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(share)
    for file in _shared_files():  # real folders of links: `ros2 launch` follows no linked folder
        link = share / file.relative_to(ROOT)
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(file)
    index = VENV / "share" / "ament_index" / "resource_index" / "packages" / "vega"
    index.parent.mkdir(parents=True, exist_ok=True)
    index.write_text("")
    for name, module in EXECUTABLES.items():
        _script(VENV / "lib" / "vega" / name, module)


if __name__ == "__main__":
    sys.exit(main())

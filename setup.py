# SPDX-License-Identifier: Apache-2.0
"""The package for colcon and pip; Python dependencies are pinned in requirements files."""

from pathlib import Path

from setuptools import find_packages, setup

#: Folders that are installed as they are, below share/vega.
SHARED = ("config", "launch", "parts", "rviz", "urdf")


def shared_files() -> list[tuple[str, list[str]]]:
    """List data files by the folder they are installed into."""
    folders: dict[str, list[str]] = {}
    for name in SHARED:
        for path in sorted(Path(name).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                folders.setdefault(f"share/vega/{path.parent}", []).append(str(path))
    return list(folders.items())


setup(
    name="vega",
    version="0.1.0",
    packages=find_packages(include=["vega_planner*", "vega_robot_driver*"]),
    package_data={"": ["*.yaml", "*.html", "*.js", "*.css", "*.json", "*.csv", "*.txt"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/vega"]),
        ("share/vega", ["package.xml"]),
        *shared_files(),
    ],
    zip_safe=False,
    author="The Vega developers",
    maintainer="The Vega developers",
    maintainer_email="vega@example.com",
    description="Plans and prints parts in enveloping layers on a multi-axis robot.",
    license="Apache-2.0",
    python_requires=">=3.11",
    entry_points={
        "console_scripts": [
            "vega = vega_planner.cli:main",
            "planner = vega_planner.nodes.planner:main",
            "print_job = vega_planner.nodes.print_job:main",
            "robot_driver = vega_robot_driver.nodes.robot_driver:main",
        ],
    },
)

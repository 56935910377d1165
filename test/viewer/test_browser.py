# SPDX-License-Identifier: Apache-2.0
"""A person's way through the viewer, in a real browser."""

import numpy as np
import pytest

from vega_planner.units import mm_to_m
from vega_planner.viewer import controls as panel
from vega_planner.viewer.picking import first_hit
from vega_planner.viewer.section import AT_Y


def pixel_of(viewer, tab, point_mm):
    """Where a point of the part frame is on the screen of a tab."""
    client = list(viewer._server.get_clients().values())[-1]
    camera = client.camera
    w, x, y, z = camera.wxyz
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = rotation.T @ (mm_to_m(np.asarray(point_mm)) - camera.position)
    canvas = tab.page.locator("canvas").first.bounding_box()
    scale = canvas["height"] / (2 * np.tan(camera.fov / 2))
    return (
        canvas["x"] + canvas["width"] / 2 + scale * seen[0] / seen[2],
        canvas["y"] + canvas["height"] / 2 + scale * seen[1] / seen[2],
    )


def region_pixels(tab):
    """How much of the screenshot has the colour of the restraint region."""
    import io

    from PIL import Image

    picture = np.asarray(Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB"), int)
    red, green, blue = np.moveaxis(picture[:, :470], 2, 0)
    return int(((red > 110) & (red > 1.5 * green) & (green > 1.5 * blue)).sum())


def click_on(viewer, tab, point_mm, until, claim):
    """Click a point of the part until the claim holds.

    A page that is still loading loses clicks, as a person on a slow machine finds out too.
    """
    client = list(viewer._server.get_clients().values())[-1]
    until(lambda: _camera_known(client))
    for _ in range(4):
        tab.page.mouse.click(*pixel_of(viewer, tab, point_mm))
        try:
            return until(claim, 10.0)
        except AssertionError:
            continue
    raise AssertionError("clicked in vain")


def _camera_known(client):
    try:
        return client.camera.update_timestamp > 0 and client.camera.image_height > 0
    except AssertionError:
        return False


def visible_point(viewer, face_normal_like):
    """A point of the part that is seen from the first view and faces that way."""
    part = viewer.part
    eye = 1000.0 * np.array(viewer._server.initial_camera.position)
    for face in np.argsort(-(part.face_normals @ np.asarray(face_normal_like)), kind="stable"):
        middle = part.vertices[part.faces[face]].mean(0)
        hit = first_hit(eye, middle - eye, part.vertices, part.faces)
        if hit is not None and hit.face == face:
            return middle, int(face)
    raise AssertionError("no such face is seen")


@pytest.fixture
def box(tmp_path):
    """A box whose six sides are the smooth regions, as a mesh file."""
    import trimesh

    mesh = trimesh.creation.box((12.0, 10.0, 6.0)).subdivide().subdivide().subdivide()
    path = tmp_path / "box.stl"
    mesh.export(path)
    path.with_suffix(".yaml").write_text('part:\n  brr: ["down"]\n')
    return path


def test_a_click_on_a_side_becomes_a_spec_that_selects_that_side_again(
    open_tabs, box, until, tmp_path, monkeypatch
):
    """Click, see it coloured, read the SPEC, use the SPEC: the same faces."""
    from vega_planner.part import load_part
    from vega_planner.settings import PartSettings

    monkeypatch.chdir(tmp_path)
    with open_tabs(box) as (viewer, new_tab):
        viewer.controls.preview.value = False
        tab = new_tab()
        tab.button("Plan").wait_for()
        before = viewer.region.picks.faces.copy()
        point, face = visible_point(viewer, (0, -1, 0.1))
        viewer.controls.show_robot.value = False
        viewer.picture.refresh()
        without = region_pixels(tab)
        click_on(viewer, tab, point, until, lambda: viewer.region.picks.faces[face])
        until(lambda: region_pixels(tab) > without + 1000)
        front = viewer.part.face_normals[:, 1] < -0.9
        assert (viewer.region.picks.faces == before | front).all()
        again = load_part(box, PartSettings(brr=viewer.region.picks.specs))
        assert (again.restrained == viewer.region.picks.faces).all()
        tab.says("--brr point:")
        click_on(viewer, tab, point, until, lambda: not viewer.region.picks.faces[face])
        assert (viewer.region.picks.faces == before).all()


def test_single_faces_go_into_a_file_that_the_command_names(
    open_tabs, box, until, tmp_path, monkeypatch
):
    from vega_planner.part import load_part
    from vega_planner.settings import PartSettings

    monkeypatch.chdir(tmp_path)
    with open_tabs(box) as (viewer, new_tab):
        viewer.controls.preview.value = False
        tab = new_tab()
        tab.button("Plan").wait_for()
        viewer.controls.click.value = panel.PICK_FACE
        point, face = visible_point(viewer, (0, 0, 1))
        click_on(viewer, tab, point, until, lambda: viewer.region.picks.faces[face])
        tab.says("--brr faces:")
        again = load_part(box, PartSettings(brr=viewer.region.picks.specs))
        assert (again.restrained == viewer.region.picks.faces).all()


def test_plan_print_pause_resume_reload_and_stop(
    open_tabs, box, real_job, until, tmp_path, monkeypatch
):
    """The whole way on the real nodes: layers appear, the print stands, survives reloads.

    A second tab looks on; either may press.
    """
    monkeypatch.chdir(tmp_path)
    job = real_job
    with open_tabs(box, job) as (viewer, new_tab):
        tab = new_tab()
        tab.press("Plan")
        until(lambda: viewer.result is not None and not viewer.jobs.planning, seconds=240)
        assert viewer.result.settings.part.brr == ("down",)
        sheets = len(viewer.result.sheets)
        assert sheets >= 5
        assert viewer.picture.visible_layers == set(range(sheets))
        tab.page.get_by_role("tab", name="Result").click()
        tab.says("print time")
        viewer.controls.machine_pace.value = panel.PACES[1]
        tab.press("Print")
        tab.says("left")
        until(lambda: job.progress().state == "printing" and job.progress().dispensing, 60.0)
        assert set(job.progress().joints) == {"x_axis", "y_axis", "z_axis", "a_axis", "b_axis"}
        assert not tab.button("Plan").is_visible()
        tab.press("Pause")
        tab.button("Resume").wait_for()
        until(lambda: job.progress().state == "paused")
        held = job.progress()
        assert not held.dispensing
        tab.page.reload()
        tab.button("Resume").wait_for()
        tab.says("paused")
        until(lambda: viewer.picture.visible_layers == _begun(viewer, held.path_time_s))
        assert job.progress().path_time_s == held.path_time_s
        onlooker = new_tab()
        onlooker.press("Resume")
        until(lambda: viewer.jobs.state.path_time_s > held.path_time_s)
        running = viewer.jobs.state.path_time_s
        tab.page.reload()
        tab.button("Pause").wait_for()
        until(lambda: viewer.jobs.state.path_time_s > running)
        tab.says("left")
        tab.press("Stop")
        until(lambda: job.progress().state == "stopped")
        assert not job.progress().dispensing
        onlooker.button("Print").wait_for()


def _begun(viewer, time_s):
    starts = viewer.result.timeline.layer_starts
    return {n for n, start in starts.items() if start <= time_s}


def test_a_second_person_is_told_and_shares_the_view(open_tabs, sample, until):
    with open_tabs(sample) as (viewer, new_tab):
        first = new_tab()
        first.button("Print").wait_for()
        second = new_tab()
        second.button("Print").wait_for()
        first.says("2 viewers are connected")
        second.says("2 viewers are connected")
        box = second.page.locator("input[type=text]:visible").first
        box.fill("100")
        box.press("Enter")
        until(lambda: viewer.picture.time_s == 100.0)
        assert viewer.picture.visible_layers == _begun(viewer, 100.0)
        second.page.close()
        until(lambda: "2 viewers" not in viewer.controls.status.content)


def test_the_reason_is_told_under_the_resting_pointer_and_on_a_click(open_tabs, sample, until):
    with open_tabs(sample) as (viewer, new_tab):
        tab = new_tab()
        tab.button("Print").wait_for()
        sheet = viewer.result.sheets[0]
        marked = np.flatnonzero(viewer.result.face_reasons[0] > 0)
        middles = sheet.vertices[sheet.faces[marked]].mean(1)
        nearest = middles[np.argmin(middles @ np.array([-0.45, 0.75, 0.0]))]
        client = next(iter(viewer._server.get_clients().values()))
        until(lambda: _camera_known(client))
        tab.page.wait_for_function("window.vegaPointer !== undefined")
        tab.page.mouse.move(*pixel_of(viewer, tab, nearest))
        tab.says("wrist_limit")
        tab.says("turn the part by 20")
        sound = sheet.vertices[sheet.faces].mean(1)
        sound = sound[sound[:, 2] > 20]
        point = sound[np.argmin(sound @ np.array([-0.45, 0.75, 0.0]))]
        says = viewer.controls.pointed
        click_on(viewer, tab, point, until, lambda: says.content.endswith("printable"))


def test_a_spec_that_selects_nothing_is_refused_in_words(open_tabs, box, until):
    with open_tabs(box) as (viewer, new_tab):
        viewer.controls.preview.value = False
        tab = new_tab()
        tab.button("Plan").wait_for()
        before = viewer.region.picks.faces.copy()
        field = tab.page.locator("xpath=//*[text()='SPECs']/following::input[1]")
        field.fill("nonsense:1")
        tab.press("Use these SPECs")
        tab.says("is not known; choices")
        assert (viewer.region.picks.faces == before).all()
        field.fill("normal:0,0,1 down")
        tab.press("Use these SPECs")
        until(lambda: viewer.region.picks.specs == ("normal:0,0,1", "down"))
        assert (viewer.region.picks.faces == (abs(viewer.part.face_normals[:, 2]) > 0.9)).all()


def test_the_resulting_layers_follow_a_pick(open_tabs, box, until, tmp_path, monkeypatch):
    """A box restrained below and in front: no layer reaches into either side."""
    monkeypatch.chdir(tmp_path)
    with open_tabs(box) as (viewer, new_tab):
        tab = new_tab()
        tab.button("Plan").wait_for()
        point, _ = visible_point(viewer, (0, -1, 0.1))
        click_on(viewer, tab, point, until, lambda: viewer.picture.visible_layers)
        tab.says("core layers")
        sheets = viewer.picture.sheets
        assert {sheet.kind for sheet in sheets} == {"envelope", "core"}
        assert viewer.picture.visible_layers == set(range(len(sheets)))
        low = sheets[0].vertices[:, 1].min()
        assert low == pytest.approx(viewer.part.vertices[:, 1].min(), abs=0.2)


def test_a_result_is_opened_with_everything_it_was_planned_with(
    open_tabs, sample, tmp_path, monkeypatch
):
    """Fields, command and a second plan start from the settings beside the result."""
    import shutil

    from vega_planner.settings import Settings, as_dict
    from vega_planner.viewer.command import save_settings

    monkeypatch.chdir(tmp_path)
    folder = shutil.copytree(sample, tmp_path / "plan")
    changes = {
        "part": {"smooth_angle_deg": 33.0, "unit": "inch", "brr": ["down"]},
        "layers": {"thickness_mm": 0.55},
        "printability": {"clearance_mm": 0.77},
        "toolpaths": {"pattern": "spiral", "angle_deg": 12.0},
        "trajectory": {"speed_mm_s": 3.5},
        "seed": 7,
    }
    planned = Settings().updated(changes)
    save_settings(planned, folder / "settings.yaml")
    with open_tabs(folder) as (viewer, new_tab):
        tab = new_tab()
        tab.button("Print").wait_for()
        restored = as_dict(viewer.region.settings())
        expected = as_dict(planned)
        # The part of a result is in millimetres, whatever the file was.
        assert restored["part"].pop("unit") == "mm"
        expected["part"].pop("unit")
        assert restored == expected
        tab.page.get_by_role("tab", name="Settings").click()
        tab.page.get_by_text("trajectory", exact=True).click()
        speed = tab.page.get_by_label("speed [mm/s]", exact=True)
        assert speed.input_value() == "3.5"


@pytest.mark.parametrize("name", ["part", "section", "print"])
def test_the_picture_looks_as_it_should(open_tabs, sample, until, name):
    """Mean colours of blocks, so that fonts, smoothing and renderers do not matter."""
    with open_tabs(sample) as (viewer, new_tab):
        controls, picture = viewer.controls, viewer.picture
        until(lambda: picture.part is not None)
        controls.show_robot.value = name == "print"
        if name == "part":
            controls.show_part.value, controls.layers.value = True, panel.NO_LAYERS
            controls.show_path.value = False
        elif name == "section":
            controls.cut.value = AT_Y
        else:
            picture.time_s = 0.5 * viewer.result.timeline.duration_s
        picture.redraw()
        tab = new_tab()
        tab.button("Print").wait_for()
        if name == "print":
            until(lambda: picture.has_robot)
        wanted = reference(name)
        until(lambda: differs(coarse(tab), wanted) < 0.02, seconds=40.0)


def coarse(tab):
    """The picture beside the panel in blocks of 10 pixels, without the notice in its corner."""
    import io

    from PIL import Image

    shot = Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB").crop((0, 160, 470, 600))
    return np.asarray(shot.resize((47, 44), Image.Resampling.BOX), float)


def differs(picture, wanted):
    """Share of the blocks whose colour is clearly another one."""
    return float((np.abs(picture - wanted).max(2) > 40).mean())


def reference(name):
    from pathlib import Path

    from PIL import Image

    path = Path(__file__).parent / "pictures" / f"{name}.png"
    return np.asarray(Image.open(path).convert("RGB"), float)


def test_the_pictures_of_the_documentation_are_taken(sample, box, tmp_path):
    """The script behind `make screenshots` runs; its pictures show something in many colours."""
    import subprocess
    import sys
    from pathlib import Path

    from PIL import Image

    script = Path(__file__).resolve().parents[2] / "tools" / "screenshots.py"
    out = tmp_path / "pictures"
    command = [sys.executable, str(script), "--out", str(out), "--plan", str(sample)]
    subprocess.run([*command, "--part", str(box)], check=True, cwd=tmp_path, timeout=240)
    names = sorted(path.name for path in out.iterdir())
    assert names == ["viewer_plan.png", "viewer_print.png", "viewer_region.png"]
    for name in names:
        pixels = np.asarray(Image.open(out / name).convert("RGB").crop((0, 0, 760, 680)), int)
        middle = pixels[150:600, 150:600].reshape(-1, 3)
        # The background is bluish grey; the things before it are not.
        assert (np.ptp(middle, axis=1) > 60).mean() > 0.05, name
        assert len(np.unique(middle // 32, axis=0)) > 10, name

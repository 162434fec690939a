"""`import jaxik` needs no extra, changes no configuration, starts no device and prints nothing."""

import pytest

from tests.helpers.fresh_import import fresh_import

# Import names of pyserial and of what the extras install.
OPTIONAL = {
    *("cobs", "dynamixel_sdk", "scservo_sdk", "serial"),
    *("equinox", "orbax", "tensorstore"),
    *("matplotlib", "trimesh", "viser", "yourdfpy"),
    *("mcap", "mcap_ros2", "yaml"),
    *("rich", "tyro"),
}


@pytest.mark.parametrize("package", ["jaxik", "training", "hardware"])
def test_import_changes_nothing_and_loads_no_extra(package, tmp_path):
    report = fresh_import(package, tmp_path)
    assert report["config"] == []
    assert report["same_environment"]
    assert not report["started_devices"]
    assert set(report["modules"]) & OPTIONAL <= ({"serial"} if package == "hardware" else set())


def test_import_jaxik_loads_neither_of_the_others(tmp_path):
    assert not {"training", "hardware"} & set(fresh_import("jaxik", tmp_path)["modules"])

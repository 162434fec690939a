"""The viewer in the browser, which needs the extra ``view``."""

from jaxik.view.browser.arm_page import ArmPage
from jaxik.view.browser.arms_page import ArmsPage
from jaxik.view.browser.plan_page import PlanPage
from jaxik.view.browser.posture_page import PosturePage
from jaxik.view.browser.recording import save_recording
from jaxik.view.browser.server import close_server, open_server
from jaxik.view.browser.stage import ShownMotion

__all__ = [
    "ArmPage",
    "ArmsPage",
    "PlanPage",
    "PosturePage",
    "ShownMotion",
    "close_server",
    "open_server",
    "save_recording",
]

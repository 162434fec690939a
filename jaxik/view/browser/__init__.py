"""The viewer in the browser; needs the extra ``view``."""

from jaxik.view.browser.arm_page import ArmPage
from jaxik.view.browser.plan_page import PlanPage
from jaxik.view.browser.server import open_server

__all__ = ["ArmPage", "PlanPage", "open_server"]

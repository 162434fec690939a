from hardware import *  # noqa: F403

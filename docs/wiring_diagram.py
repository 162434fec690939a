"""Draw wiring.png: python docs/wiring_diagram.py."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch

RED, BLACK, YELLOW, GREEN, BLUE = "#c62828", "#212121", "#e6a100", "#2e7d32", "#1565c0"
PULSES = [
    ("D2", "right wrist roll"),
    ("D3", "right hand pitch"),
    ("D4", "right gripper"),
    ("D5", "left wrist roll"),
    ("D6", "left hand pitch"),
    ("D7", "left gripper"),
]
CHAINS = [("D8", "right"), ("D9", "left")]
PLACES = ["/1 shoulder\nswing", "/2 shoulder\nlift", "/3 upper-arm\nroll", "/4 elbow"]


class Drawing:
    """Boxes and wires on a sheet."""

    def __init__(self) -> None:
        self.figure, self.axes = plt.subplots(figsize=(12, 8.6))
        self.axes.set(xlim=(0, 120), ylim=(0, 86), aspect="equal")
        self.axes.axis("off")
        self.figure.subplots_adjust(0, 0, 1, 1)

    def box(self, x, y, width, height, text, color="#eceff1", size=9.0, weight="normal"):
        style = "round,pad=0,rounding_size=0.8"
        self.axes.add_patch(FancyBboxPatch((x, y), width, height, style, facecolor=color, edgecolor=BLACK, lw=1.1))
        self.axes.text(x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=size, weight=weight)

    def wire(self, *points, color=BLACK, width=1.6, zorder=0.5):
        self.axes.plot(*zip(*points, strict=True), color=color, lw=width, solid_joinstyle="round", zorder=zorder)

    def dot(self, x, y, color=BLACK):
        self.axes.plot([x], [y], "o", color=color, ms=5, zorder=3)

    def note(self, x, y, text, **options):
        self.axes.text(x, y, text, **({"fontsize": 8.5, "va": "center"} | options))


def board(d: Drawing) -> None:
    d.box(35, 27, 17, 50, "", "#dfe9f5")
    d.note(43.5, 74, "Arduino Pro Mini\n5 V, 16 MHz", ha="center", weight="bold", fontsize=9.5)
    for i, (pin, _) in enumerate(PULSES + CHAINS):
        d.note(51, pin_y(i), pin, ha="right", family="monospace")
    for y, pin in ((68, "RX D0"), (65, "TX D1"), (62, "DTR"), (55, "VCC (5 V)"), (52, "GND")):
        d.note(36, y, pin, family="monospace")


def pin_y(i: int) -> float:
    return 69 - 4.2 * i if i < 6 else 39 - 8 * (i - 6)


def host(d: Drawing) -> None:
    d.box(3, 60, 19, 11, "USB serial adapter, 5 V\n(or HC-05 Bluetooth:\nsee the text)", "#fff8e1")
    d.note(12.5, 73, "115200 baud, to the computer", ha="center")
    for y, label in ((68, "TX"), (65, "RX"), (62, "DTR")):
        d.wire((22, y), (35, y), color=BLUE)
        d.note(23, y + 1.1, label, fontsize=7, color=BLUE)


def supply(d: Drawing) -> None:
    d.box(3, 30, 19, 12, "servo supply\n5 V, 8 A or more", "#fdecea", weight="bold")
    d.wire((8, 42), (8, 47), color=RED, width=2.6)
    d.box(4.8, 43.2, 6.4, 2.6, "fuse 10 A", "#ffffff", 7)
    d.box(4, 47, 8, 4, "switch", "#ef9a9a", 8.5)
    d.wire((8, 51), (8, 55), (30, 55), color=RED, width=2.6)
    d.wire((30, 55), (35, 55), color=RED)
    d.note(9, 56.6, "feeds the board too: see the text", fontsize=7, color=RED)
    d.wire((17, 42), (17, 52), (35, 52), width=2.6)
    d.note(23, 50.6, "common ground", fontsize=7)
    d.box(24, 40, 7, 5, "1000 µF", "#ffffff", 7.5)
    d.wire((27.5, 55), (27.5, 45), color=RED)
    d.wire((27.5, 40), (27.5, 36), (17, 36), (17, 30.0), width=1.6)
    d.dot(27.5, 55, RED)


def rails(d: Drawing) -> None:
    for y, color, label in ((82, RED, "+ servo rail, from behind the switch"), (80, BLACK, "ground rail")):
        d.wire((30 if color == RED else 32, y), (114, y), color=color, width=2.6)
        d.note(115, y, "+" if color == RED else "–", color=color, weight="bold", fontsize=12)
        d.note(58, y + 0.95, label, fontsize=7, color=color)
    d.wire((30, 55), (30, 82), color=RED, width=2.6)
    d.wire((32, 52), (32, 80), width=2.6)
    d.dot(30, 55, RED)
    d.dot(32, 52)


def hobby_servos(d: Drawing) -> None:
    for i, (pin, joint) in enumerate(PULSES):
        y = pin_y(i)
        d.wire((52, y), (72, y), color=YELLOW)
        d.note(53, y + 1, f"{pin}  pulse", fontsize=7, color=YELLOW)
        d.box(72, y - 1.7, 22, 3.4, f"hobby servo: {joint}", "#f1f8e9", 8.5)
        d.wire((94, y + 0.7), (106, y + 0.7), color=RED)
        d.wire((94, y - 0.7), (109, y - 0.7))
    d.wire((106, 82), (106, pin_y(5) + 0.7), color=RED)
    d.wire((109, 80), (109, pin_y(5) - 0.7))
    d.dot(106, 82, RED)
    d.dot(109, 80)
    d.note(81, pin_y(5) - 3.4, "red to +, brown or black to –, orange, white or yellow to the pin", fontsize=7)


def chains(d: Drawing) -> None:
    for i, (_, side) in enumerate(CHAINS):
        y = pin_y(6 + i)
        low = 17 - 13 * i
        d.wire((52, y), (54 + 2 * i, y), (54 + 2 * i, low + 4), (57, low + 4), color=YELLOW)
        d.box(57, low + 2.6, 6, 2.8, "1 kΩ", "#ffffff", 8)
        d.wire((63, low + 4), (74, low + 4), color=YELLOW)
        d.dot(66, low + 4, YELLOW)
        d.wire((66, low + 4), (66, low + 6.2), color=YELLOW)
        d.box(63.2, low + 6.2, 5.6, 2.8, "22 kΩ", "#ffffff", 7.5)
        d.wire((66, low + 9), (66, low + 10.2), (71, low + 10.2), (71, low + 5.6), color=RED)
        d.dot(71, low + 5.6, RED)
        for k, place in enumerate(PLACES):
            x = 74 + 11 * k
            d.box(x, low, 9.4, 8, place, "#e3f2fd", 8)
            if k < 3:
                for offset, color in ((2.4, BLACK), (4, YELLOW), (5.6, RED)):
                    d.wire((x + 9.4, low + offset), (x + 11, low + offset), color=color)
        d.note(60, low - 1.6, f"{side} arm: four Meccano smart servos in a row; data, + and – in one plug", fontsize=8)
        d.wire((74, low + 5.6), (59.5, low + 5.6), color=RED)
        d.note(57.5, low + 6.6, "+", color=RED, weight="bold")
        d.wire((74, low + 2.0), (59.5, low + 2.0))
        d.note(57.5, low + 1.4, "–", weight="bold")
    d.box(3, 4, 40, 19, "", "#ffffff")
    lines = [
        (RED, "+  servo supply, behind fuse and switch"),
        (BLACK, "–  common ground"),
        (YELLOW, "signal: pulses D2 to D7, data D8 and D9"),
        (BLUE, "serial line, crossed: TX to RX"),
    ]
    for k, (color, text) in enumerate(lines):
        d.wire((5, 20 - 4.2 * k), (10, 20 - 4.2 * k), color=color, width=2.4, zorder=2)
        d.note(12, 20 - 4.2 * k, text)


def main() -> None:
    """Write the picture beside this file."""
    d = Drawing()
    for part in (board, host, supply, rails, hobby_servos, chains):
        part(d)
    d.figure.savefig(Path(__file__).with_name("wiring.png"), dpi=110, facecolor="white")


if __name__ == "__main__":
    main()

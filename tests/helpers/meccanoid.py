"""A fake Meccanoid behind its Bluetooth frames: eight servos, a PIN, modes; some answers get lost."""

import numpy as np

from hardware.boards.meccanoid import content, frame


class MeccanoidFake:
    """An exchange for :class:`hardware.boards.meccanoid.MeccanoidBoard`.

    Args:
        clock: Clock of the host.
        took_s: Time that one exchange takes [s].
        lose: Probability that an answer gets lost.
        garble: Probability that an answer is garbled.
        refuse: True to refuse the PIN, as without a press of the yellow button.
        seed: Seed of loss and garbling.
    """

    def __init__(self, clock, took_s=0.03, lose=0.0, garble=0.0, refuse=False, seed=0):
        self.clock, self.took_s, self.lose, self.garble, self.refuse = clock, took_s, lose, garble, refuse
        self.pose, self.mode, self.closed, self.lost, self.gone = (
            [134, 214, 28, 225, 41, 120, 126, 126],
            4,
            False,
            0,
            False,
        )
        self.history, self.operations = [], []
        self._random = np.random.default_rng(seed)

    def ask(self, request, answer_s):
        self.clock.sleep(self.took_s)
        payload = content(request, request[0])
        assert payload is not None
        self.operations.append(request[0])
        answer = frame(request[0], self._do(request[0], payload))
        if self.gone or self._random.random() < self.lose:
            self.lost += 1
            self.clock.sleep(answer_s)
            return None
        if self._random.random() < self.garble:
            self.lost += 1
            return answer[:5] + bytes((answer[5] ^ 1,)) + answer[6:]
        return answer

    def _do(self, operation, payload):
        match operation:
            case 0x1A:
                return b"\x00\x01\xff" if self.refuse else b"\x00\x01\x00"
            case 0x08 if self.mode == 2:
                self.pose = list(payload[:8])
                self.history.append((self.clock.now(), tuple(self.pose)))
            case 0x0B:
                self.mode = payload[0]
            case 0x09:
                return bytes(self.pose)
        return b""

    def close(self):
        self.closed = True

"""Ctrl-C ends all processes that a script has started, also those of its subshells."""

import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest

CHILDREN = sys.argv.pop(1)  # scripts/children.sh


def is_running(process):
    """True for a process that has not ended, as a zombie has."""
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


class ChildrenTest(unittest.TestCase):
    def interrupt(self, line):
        """Runs a line of a script that starts "$@", interrupts the script, and returns its status."""
        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, "process")
            script = subprocess.Popen(
                ["bash", "-c", f'source "{CHILDREN}"; {line}', "script", "sh", "-c", f'echo $$ >"{file}"; exec sleep 1000'],
                start_new_session=True,
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )
            while not os.path.exists(file) or os.path.getsize(file) == 0:  # the timeout of ctest limits the wait
                time.sleep(0.01)
            with open(file, encoding="utf-8") as text:
                process = int(text.read())
            os.killpg(script.pid, signal.SIGINT)
            status = script.wait()
            running = is_running(process)
            if running:
                os.kill(process, signal.SIGKILL)
            self.assertFalse(running, "the process goes on after its script has ended")
            return status

    def test_a_command(self):
        self.assertEqual(self.interrupt('run "$@"'), 130)

    def test_a_command_of_a_subshell(self):
        self.assertEqual(self.interrupt('(run "$@") || exit 1'), 130)

    def test_a_background_process(self):
        self.assertEqual(self.interrupt('start "$@"; wait'), 130)


if __name__ == "__main__":
    unittest.main()

"""Finds and runs the program `lumel`, and reads its progress."""

import os
import queue
import re
import shutil
import subprocess
import threading

# `lumel bake --progress lines`: "progress 42.0 % gather, 12 s left".
PROGRESS = re.compile(r"progress +([0-9.]+) % ([a-z]+)(?:, (.+) left)?")


def find_program(preferred):
    """Looks for the program in the preferences, $LUMEL, the search path, and cargo's folder."""
    name = "lumel.exe" if os.name == "nt" else "lumel"
    cargo = os.path.join(os.path.expanduser("~"), ".cargo", "bin", name)
    for path in (preferred, os.environ.get("LUMEL"), shutil.which("lumel"), cargo):
        if path and os.path.isfile(path):
            return path
    return None


class Bake:
    """A running `lumel bake`. Call `poll` regularly; it never blocks."""

    def __init__(self, program, arguments):
        self.share, self.text, self.said = 0.0, "starting", []
        self._lines = queue.SimpleQueue()
        # Without a console window on Windows.
        flags = getattr(subprocess, "CREATE_NO_WINDOW", 0)
        self._process = subprocess.Popen(
            [program, "bake", *arguments, "--progress", "lines"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            creationflags=flags,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stderr:
            self._lines.put(line.rstrip())

    def _take(self):
        while not self._lines.empty():
            line = self._lines.get()
            found = PROGRESS.match(line)
            if not found:
                self.said.append(line)
                continue
            self.share = float(found[1]) / 100
            self.text = found[2] + (f", {found[3]} left" if found[3] else "")

    def poll(self):
        """The exit code, or None while the bake is running."""
        code = self._process.poll()
        if code is not None:
            self._reader.join()
        self._take()
        return code

    def wait(self):
        self._process.wait()
        return self.poll()

    def cancel(self):
        """Stops the bake; the results of the previous one stay unchanged."""
        self._process.terminate()

    def warnings(self):
        return [line[9:] for line in self.said if line.startswith("warning: ")]

    def summary(self):
        return next((line for line in self.said if line.startswith("baked ")), "baked")

    def error(self):
        errors = [line[7:] for line in self.said if line.startswith("error: ")]
        return errors[-1] if errors else "\n".join(self.said[-3:])

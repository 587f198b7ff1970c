#!/usr/bin/env python3
"""Checks that the benchmarks, which only the target `bench` builds, still compile.

Usage: check_syntax.py FOLDER, of a build; ends with 1 and the compiler's words if one does not.
"""
import json
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor


def check(entry):
    words = shlex.split(entry["command"])
    if os.path.basename(words[0]) == "ccache":
        words = words[1:]
    at = words.index("-o")
    words = words[:at] + words[at + 2:] + ["-fsyntax-only"]
    result = subprocess.run(words, cwd=entry["directory"], capture_output=True, text=True)
    if result.returncode != 0:
        print(result.stderr, file=sys.stderr)
    return result.returncode == 0


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    with open(os.path.join(sys.argv[1], "compile_commands.json")) as file:
        entries = [e for e in json.load(file) if os.sep + os.path.join("tests", "bench", "") in e["file"]]
    if not entries:
        sys.exit("no benchmarks in the build")
    with ThreadPoolExecutor(2) as pool:
        if not all(pool.map(check, entries)):
            sys.exit(1)
    print(f"{len(entries)} files compile")


if __name__ == "__main__":
    main()

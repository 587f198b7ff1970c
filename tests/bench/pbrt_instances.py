#!/usr/bin/env python3
"""Seconds and peak memory that opening a pbrt file of many instances takes.

Usage: pbrt_instances.py [--trex build/trex] [--counts 1e4,1e5,1e6] [--folder .]
Prints a table: of each count the file's bytes, the seconds and the largest resident size of `trex info`.
"""
import argparse, os, random, subprocess, time

HERE = os.path.dirname(os.path.abspath(__file__))
HEAD = """LookAt 0 50 -100  0 0 0  0 1 0
Camera "perspective" "float fov" 45
WorldBegin
LightSource "infinite" "rgb L" [1 1 1]
ObjectBegin "tree"
Material "matte" "rgb Kd" [.2 .5 .1]
Shape "trianglemesh" "integer indices" [0 1 2 0 2 3 0 3 1 1 3 2] "point P" [0 1 0 1 0 0 -1 0 1 -1 0 -1]
Material "matte" "rgb Kd" [.3 .2 .1]
Shape "cylinder" "float radius" .1 "float zmin" -1 "float zmax" 0
ObjectEnd
"""


def write(path, count):
    chance = random.Random(1)
    with open(path, "w") as f:
        f.write(HEAD)
        for _ in range(count):
            x, z, turn = chance.uniform(-99, 99), chance.uniform(-99, 99), chance.uniform(0, 360)
            f.write(f"AttributeBegin\nTranslate {x:.4f} 0 {z:.4f}\nRotate {turn:.3f} 0 1 0\nScale 1 1.2 1\n"
                    'ObjectInstance "tree"\nAttributeEnd\n')


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trex", default=os.path.join(HERE, "../../build/trex"))
    parser.add_argument("--counts", default="1e4,1e5,1e6")
    parser.add_argument("--folder", default=".")
    a = parser.parse_args()
    print("| instances | file, MB | seconds | peak, MiB |\n|---|---|---|---|")
    for count in (int(float(c)) for c in a.counts.split(",")):
        path = os.path.join(a.folder, "instances.pbrt")
        write(path, count)
        begin = time.monotonic()
        process = subprocess.Popen([a.trex, "info", path], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        if status != 0:
            raise SystemExit(f"trex info ended with {os.waitstatus_to_exitcode(status)}")
        print(f"| {count} | {os.path.getsize(path) / 1e6:.1f} | {time.monotonic() - begin:.2f} | "
              f"{usage.ru_maxrss / 1024:.0f} |", flush=True)
        os.remove(path)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Would rays have to travel? What several machines would take for a model whose pages fit in none of them, by measured parts.

    rays_or_pages.py --trex build/trex MODEL.trex [--machines 2,4] [--size 320x180] [--spp 20] [--cache 0.1] [--share 0.4]

Renders on this machine, one thread each: all samples; those of one of so many machines; all with as much cache as they have together
(pages that are one machine's each); and the latter two with pages kept unpacked. From that, seconds of each machine with `--share` of a core:

  everyone  each machine loads what its samples need and unpacks it at every load
  owners    each page is one machine's; rays that wait for it travel there and come back with what they met
  kept      everyone, but what was unpacked once is read again (--page-disk)

With a central database packed pages come from machine 0. A ray that waits is 120 bytes (question, nearest hit so far, groups it waits for)
and its answer 150 (hit and triangle); it goes and comes back at least once (pages are parted by regions, it meets one owner), at most
for each page. A ray costs 1 microsecond of processors each way, at either end; TCP 1 nanosecond a byte at either end."""
import argparse, json, os, resource, subprocess, tempfile

THERE, BACK, RAY_SECONDS, BYTE_SECONDS = 120, 150, 1e-6, 1e-9


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model")
    parser.add_argument("--trex", required=True)
    parser.add_argument("--machines", default="2,4")
    parser.add_argument("--megabits", default="1000,100")
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--spp", type=int, default=20)
    parser.add_argument("--cache", type=float, default=0.1, help="of the pages' memory, each machine")
    parser.add_argument("--share", type=float, default=0.4, help="of a core, each machine")
    a = parser.parse_args()
    pages = json.loads(subprocess.run([a.trex, "info", a.model, "--json"], check=True, capture_output=True, text=True).stdout)["mesh_pages"]
    folder = tempfile.TemporaryDirectory(prefix="trex-rays-", dir=os.getcwd())

    def render(spp, caches, kept, size=a.size, opening=0.0):
        cache = min(max(int(pages["memory_bytes"] * a.cache * caches), pages["largest_page_bytes"] + 8192), pages["memory_bytes"] - 1)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        p = subprocess.run([a.trex, "render", a.model, "-o", os.path.join(folder.name, "a.exr"), "--size", size, "--spp", str(spp),
                            "--exact", "1", "--device", "none", "--denoise", "off", "--threads", "1", "--cache", str(cache), "--page-disk",
                            "auto" if kept else "off", "--json"], check=True, capture_output=True, text=True, env={**os.environ, "TREX_OIDN": "none"})
        r = json.loads(p.stdout)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime - opening
        # Clocks count what others on this machine take, too; processors do not.
        r["unpacking"] = processor * r["unpacking_thread_seconds"] / (r["tracing_thread_seconds"] - r["waiting_thread_seconds"])
        r["work"] = processor - r["unpacking"]
        if opening == 0.0:
            return processor
        print(f"{spp:3} samples, cache {cache / 1e6:6.1f} MB{', kept' if kept else '      '}: tracing {r['work']:5.1f} s, unpacking "
              f"{r['unpacking']:5.1f} s, {r['page_loads']} loads, {r['page_loads'] - r['page_loads_restored']} unpacked; "
              f"{r['rays_that_waited'] / 1e6:.1f} M rays waited, {r['ray_waits'] / 1e6:.1f} M times, "
              f"{r['ray_waits'] / r['page_loads']:.0f} a load", flush=True)
        return r

    opening = render(1, 1, False, "8x8")
    print(f"seconds of a processor, without the {opening:.1f} that opening the model takes:")
    whole, keptWhole = render(a.spp, 1, False, opening=opening), render(a.spp, 1, True, opening=opening)
    page_bytes = os.path.getsize(a.model) / pages["pages"]
    alone = {False: whole["work"] + whole["unpacking"], True: keptWhole["work"] + keptWhole["unpacking"]}
    print(f"one machine: {alone[False] / a.share:.0f} s, kept {alone[True] / a.share:.0f} s\n")
    print("machines  link           way        processor     link   seconds  speed-up  of what was")
    for n in [int(x) for x in a.machines.split(",")]:
        part, kept = (render(a.spp // n, 1, keeps, opening=opening) for keeps in (False, True))
        together = render(a.spp, n, False, opening=opening)
        hops = [2 * whole[key] * (n - 1) / n / n for key in ("rays_that_waited", "ray_waits")]  # sent by each machine
        for megabits in [int(x) for x in a.megabits.split(",")]:
            byte = 8e-6 / megabits
            rows = []
            for central in (False, True):
                name = f"{megabits} Mbit/s {'central' if central else 'local'}"

                def row(way, processor, sent, loads, before):
                    link = byte * (sent + ((n - 1) * loads * page_bytes if central else 0))
                    seconds = max(processor / a.share, link)
                    rows.append((name, way, processor / a.share, link, seconds, before / a.share))

                row("everyone", part["work"] + part["unpacking"], 0, part["page_loads"], alone[False])
                for way, count in zip(("owners, least", "owners, most"), hops):
                    sent = count * (THERE + BACK) / 2
                    row(way, whole["work"] / n + together["unpacking"] / n + 2 * (count * RAY_SECONDS + sent * BYTE_SECONDS), sent,
                        together["page_loads"] / n, alone[False])
                row("kept", kept["work"] + kept["unpacking"], 0, kept["page_loads"] - kept["page_loads_restored"], alone[True])
            first = {}
            for name, way, processor, link, seconds, before in rows:
                first.setdefault(name, seconds)
                print(f"{n:8}  {name:18} {way:14} {processor:6.1f} s {link:6.1f} s {seconds:7.1f} s {before / seconds:8.2f}x "
                      f"{first[name] / seconds:10.2f}x", flush=True)


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Several machines on one: network namespaces with links of a given speed, and a share of the cores each. As root.

    machines.py --trex build/trex [--triangles 1e6] [--machines 1,2,4] [--megabits 1000,100] [--share 0.4] [--runs 1]
                [--model FILE] [--page-disk auto|off] [--databases local,central] [--by-machine] [--round-robin]
                [--max-memory 600M]
    machines.py --trex build/trex --kill FOLDER [--triangles 1e6] [--share 0.4] [--runs 3]

    machines.py --trex build/trex --window [--megabits 100] [--share 0.4] [--triangles 1e6] [--runs 3] [--elsewhere SHARES]

The second, with the Open MPI 5 of scripts/openmpi5 FOLDER: four processes with a share of the cores each, undisturbed and with one
killed at half time, in turn (no links: all on this machine).

The third: a window by itself, and one with a server (trex worker) at the other end of a link, in turn: edit to coarse frame, and to a
picture of so many samples. Needs Xvfb. --elsewhere: the model is the server's alone; the window has room for these shares of its pages
(1: all), and what its pages take of the link before the coarse frame is said apart.

With --round-robin each job of several machines runs again with pages in turn (--page-order round-robin), for the ratio of seconds
(bar 1.5 at 100 Mbit/s); with --max-memory each process has that limit, and its peak is told as a share of it (bar 1.05).

Prints for each number of machines how long the same picture takes, and what travelled: central scene database (only machine 0 has
the model, the others start with nothing) and local copies. All pictures must have the same bytes. Leaves nothing behind."""
import argparse, json, os, resource, shutil, signal, statistics, subprocess, sys, tempfile, time

NAME = f"trex-bench-{os.getpid()}"  # others may measure, too
CPU = "/sys/fs/cgroup/cpu"


def call(*command, check=True):
    return subprocess.run([str(c) for c in command], check=check, capture_output=True, text=True)


def give_share(group, share):
    os.makedirs(f"{CPU}/{group}", exist_ok=True)
    for key, value in (("cpu.cfs_period_us", 20000), ("cpu.cfs_quota_us", int(20000 * share))):
        with open(f"{CPU}/{group}/{key}", "w") as f:
            f.write(str(value))


def remove_group(group):
    """With what still runs in it, if the bench was stopped."""
    folder = f"{CPU}/{group}"
    for _ in range(100):
        if not os.path.isdir(folder):
            return
        try:
            with open(f"{folder}/cgroup.procs") as f:
                for process in f.read().split():
                    os.kill(int(process), signal.SIGKILL)
            os.rmdir(folder)
        except OSError:  # they are about to end
            time.sleep(0.05)


class Machines:
    """`count` namespaces behind one switch."""

    def __init__(self, count, megabits, share, folder):
        self.count, self.folder = count, folder
        self.remove()
        call("ip", "netns", "add", NAME)
        call("ip", "-n", NAME, "link", "add", "switch", "type", "bridge")
        call("ip", "-n", NAME, "link", "set", "switch", "up")
        for i in range(count):
            space = f"{NAME}-{i}"
            call("ip", "netns", "add", space)
            call("ip", "link", "add", f"port{i}", "netns", NAME, "type", "veth", "peer", "name", "net", "netns", space)
            call("ip", "-n", NAME, "link", "set", f"port{i}", "master", "switch", "up")
            call("ip", "-n", space, "addr", "add", f"10.77.0.{i + 1}/24", "dev", "net")
            call("ip", "-n", space, "link", "set", "net", "up")
            call("ip", "-n", space, "link", "set", "lo", "up")
            limit = ["tbf", "rate", f"{megabits}mbit", "burst", "256kb", "latency", "50ms"]
            call("tc", "-n", space, "qdisc", "add", "dev", "net", "root", *limit)
            call("tc", "-n", NAME, "qdisc", "add", "dev", f"port{i}", "root", *limit)
            give_share(space, share)
        # What mpirun calls instead of ssh: it enters the machine that has the address. (In a namespace /sys is another one.)
        self.agent = os.path.join(folder, "agent")
        with open(self.agent, "w") as f:
            f.write('#!/bin/sh\nnumber=$((${1##*.} - 1)); shift\n'
                    f'echo $$ >{folder}/cpu/{NAME}-$number/cgroup.procs || exit 1\n'
                    f'mkdir -p {folder}/$number; export TMPDIR={folder}/$number; cd {folder}/$number\n'
                    f'exec ip netns exec {NAME}-$number unshare --uts sh -c "hostname machine$number; $*"\n')
        os.chmod(self.agent, 0o755)
        with open(os.path.join(folder, "hosts"), "w") as f:
            f.writelines(f"10.77.0.{i + 1} slots=1\n" for i in range(count))

    def remove(self):
        for i in range(16):
            remove_group(f"{NAME}-{i}")
            call("ip", "netns", "del", f"{NAME}-{i}", check=False)
        call("ip", "netns", "del", NAME, check=False)

    def run(self, trex, arguments):
        return json.loads(self.call(self.count, [trex, "render", *arguments]))

    def call(self, count, program):
        network = "10.77.0.0/24"
        mpi = ["mpirun", "--allow-run-as-root", "--bind-to", "none", "--hostfile", os.path.join(self.folder, "hosts"), "-n", count,
               "--mca", "plm_rsh_agent", self.agent, "--mca", "btl", "tcp,self", "--mca", "btl_tcp_if_include", network,
               "--mca", "oob_tcp_if_include", network]
        command = " ".join(f"'{x}'" for x in [*mpi, *program])
        p = subprocess.run([self.agent, "10.77.0.1", command], capture_output=True, text=True)
        if p.returncode != 0:
            sys.exit(f"{command}\nended with {p.returncode}:\n{p.stderr}")
        return p.stdout


class Killed:
    """Processes on this machine by Open MPI 5, each with its share of the cores; one of them is killed."""

    def __init__(self, openmpi, share, folder, count=4):
        self.count, self.openmpi = count, openmpi
        self.wrapper = os.path.join(folder, "wrapper")
        with open(self.wrapper, "w") as f:
            f.write(f'#!/bin/sh\necho $$ >{CPU}/{NAME}-$OMPI_COMM_WORLD_RANK/cgroup.procs || exit 1\n'
                    f'echo $$ >{folder}/pid-$OMPI_COMM_WORLD_RANK\nexec "$@"\n')
        os.chmod(self.wrapper, 0o755)
        self.folder = folder
        for i in range(count):
            give_share(f"{NAME}-{i}", share)

    def remove(self):
        for i in range(self.count):
            if os.path.isdir(f"{CPU}/{NAME}-{i}"):
                os.rmdir(f"{CPU}/{NAME}-{i}")

    def run(self, trex, arguments, kill_after=None):
        mpi = [os.path.join(self.openmpi, "bin", "mpirun"), "--with-ft", "ulfm", "--allow-run-as-root", "--bind-to", "none",
               "--map-by", ":OVERSUBSCRIBE", "-n", self.count]
        p = subprocess.Popen([str(c) for c in [*mpi, self.wrapper, trex, "render", *arguments]], stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True,
                             env={**os.environ, "LD_LIBRARY_PATH": os.path.join(self.openmpi, "lib")})
        if kill_after:
            time.sleep(kill_after)
            with open(os.path.join(self.folder, "pid-2")) as f:
                os.kill(int(f.read()), signal.SIGKILL)
        out, err = p.communicate()
        if p.returncode != 0:
            sys.exit(f"ended with {p.returncode}:\n{err}")
        return json.loads(out)


def kill_one(a, trex, folder, job):
    """What it costs that one of four dies at half time."""
    killed = Killed(os.path.abspath(a.kill), a.share, folder)
    try:
        out, first, ratios = os.path.join(folder, "a.exr"), None, []
        for _ in range(a.runs):
            seconds = []
            for after in (None, True):
                start = time.monotonic()
                report = killed.run(trex, [*job, "-o", out, "--scene-db", "local"], after and 0.5 * seconds[0])
                seconds.append(time.monotonic() - start)
                with open(out, "rb") as f:
                    picture = f.read()
                first = first or picture
                if picture != first:
                    sys.exit("another picture")
            ratios.append(seconds[1] / seconds[0])
            print(f"four: {seconds[0]:.1f} s; one killed after {0.5 * seconds[0]:.1f} s: {seconds[1]:.1f} s, {ratios[-1]:.2f}x; "
                  f"jobs given out again: {report['jobs_given_out_again']}", flush=True)
        print(f"median {statistics.median(ratios):.2f}x (bar 1.35x), the same bytes")
    finally:
        killed.remove()


def window(a, trex, folder, model):
    """What a server at the other end of a link does for a window."""
    kinds = {
        "camera": lambda i: {"camera": {"orbit": [0.04 * (1 - 2 * (i % 2)), 0.01]}},
        "material": lambda i: {"material": {"index": 0, "roughness": 0.2 + 0.05 * (i % 10), "base_color": [0.5, 0.05 * (i % 20), 0.4, 1]}},
        "light": lambda i: {"light": {"add": True, "name": "bar", "position": [0, 1, 0], "intensity": [1, 1, 1]} if i == 0 else
                            {"name": "bar", "intensity": [0.5 + 0.2 * i] * 3}},
    }
    steps = [{"wait": "machines"}, {"wait": "ready", "frames": 5}]
    steps += [{"label": kind, **edit(i), "frames": 3} for kind, edit in kinds.items() for i in range(a.edits)]
    steps += [{"label": "settle", "material": {"index": 0, "roughness": 0.4}}, {"label": "settle", "wait": "idle"}]
    script, report = os.path.join(folder, "script.json"), os.path.join(folder, "report.json")
    with open(script, "w") as f:
        json.dump({"trex": 1, "size": a.size, "steps": steps}, f)
    view = [trex, "view", "--replay", script, "--report", report, "--device", "none", "--exact", a.exact, "--spp", a.spp,
            "--threads", 1, "-q"]
    worker = [":", "-n", 1, trex, "worker", "--threads", 1]
    ways = {"alone": [*view, model], "with a server": [*view, model, *worker]}
    if a.elsewhere:
        pages = json.loads(call(trex, "info", model, "--json").stdout)["mesh_pages"]
        del ways["with a server"]
        for share in a.elsewhere.split(","):
            cache = max(int(pages["memory_bytes"] * float(share)) + 8192, pages["largest_page_bytes"] + 8192)
            ways[f"model elsewhere, room for {share}"] = [*view, "--cache", cache, *worker, model]
    reading, writing = os.pipe()
    xvfb = subprocess.Popen(["Xvfb", "-displayfd", str(writing), "-screen", "0", "1280x720x24", "-nolisten", "tcp"], pass_fds=[writing],
                            stderr=subprocess.DEVNULL)
    os.close(writing)
    machines = None
    try:
        with os.fdopen(reading) as pipe:
            os.environ["DISPLAY"] = ":" + pipe.readline().strip()
        for megabits in a.megabits.split(","):
            machines = Machines(2, megabits, a.share, folder)
            coarse, settled, used, samples, opened, longest = {}, {}, {}, {}, {}, {}
            for run in range(a.runs):
                for who, command in ways.items():
                    machines.call(1, command)
                    with open(report) as f:
                        said = json.load(f)
                    for step in said["steps"]:
                        if step["label"] in kinds:
                            link = 8e-3 * step["first_coarse_page_bytes"] / float(megabits) if "elsewhere" in who else 0.0
                            coarse.setdefault((who, step["label"]), []).append((step["first_coarse_ms"], link))
                    settling = [step for step in said["steps"] if step["label"] == "settle"]
                    settled.setdefault(who, []).append(sum(step["seconds"] for step in settling))
                    used.setdefault(who, []).append(sum(step["processor_seconds"] for step in settling))
                    opened.setdefault(who, []).append(said["open"]["first_coarse_ms"])
                    longest[who] = max(longest.get(who, 0.0), said["turns"]["longest_step_ms"])
                    samples[who] = said["machines"][1]["samples"] if len(said.get("machines", [])) > 1 else 0
            machines.remove()
            for kind in kinds:
                for who in ways:
                    times = coarse[who, kind]
                    ms, link, rest = (statistics.median(t) for t in zip(*((t, l, t - l) for t, l in times)))
                    print(f"{megabits:>4} Mbit  {kind:>8}: edit to coarse frame {ms:6.1f} ms {who}"
                          + (f"; link {link:.1f} ms, beyond it {rest:.1f} ms" if "elsewhere" in who else "")
                          + f" (bar 67), medians of {len(times)}", flush=True)
            for who in ways:
                seconds = statistics.median(settled[who])
                print(f"{megabits:>4} Mbit  edit to {a.spp} samples: {seconds:.2f} s {who}, {statistics.median(settled['alone']) / seconds:.2f}x; the "
                      f"window's processor {statistics.median(used[who]):.2f} s; {samples[who]} samples by the server in the last run; opened in "
                      f"{1e-3 * statistics.median(opened[who]):.2f} s; longest step {longest[who]:.0f} ms", flush=True)
    finally:
        if machines:
            machines.remove()
        xvfb.terminate()


HEAD = "link      machines  database  seconds  speed-up  model sent  passed on  of planned  samples back  peak"


def tell(a, megabits, count, database, seconds, alone, report, used):
    rows = report.get("machines", [])
    sent, passed, got, planned = (sum(r[key] for r in rows) / 1e6 for key in
                                  ("model_bytes_sent", "page_bytes_passed_on", "page_bytes_received", "page_bytes_planned"))
    peak = max([r["peak_resident_bytes"] for r in rows] or [report["peak_resident_bytes"]])
    central = database == "central"
    print(f"{megabits:>4} Mbit {count:9} {database:>9} {seconds:8.1f} {alone / seconds:8.2f}x {sent:8.1f} MB {passed:7.1f} MB "
          f"{got / planned if central and planned else 0:11.2f} {report.get('machine_bytes_received', 0) / 1e6:10.1f} MB "
          f"{peak / 1e6:5.0f} MB{of_limit(a, peak)}", flush=True)
    if a.by_machine and not rows:
        print(f"     {report['page_loads']} loads, {report['page_loads'] - report['page_loads_restored']} unpacked; {used:.1f} s of processors")
    for r in rows if a.by_machine else []:
        print(f"     machine {r['machine']}: {r['tile_samples']} tile samples in {r['tracing_seconds']:.1f} s "
              f"(waiting {r['waiting_thread_seconds']:.1f}, unpacking {r['unpacking_thread_seconds']:.1f}), "
              f"{r['page_loads']} loads, {r['page_loads'] - r['page_loads_restored']} unpacked; {r['photons']} photons, "
              f"{r['photon_seconds']:.1f} s; reading threads {r['reading_thread_seconds']:.1f}; {r['processor_seconds']:.1f} s of processors")
        if central:
            print(f"        pages: {r['page_bytes_received'] / 1e6:.1f} MB received of {r['page_bytes_planned'] / 1e6:.1f} planned, "
                  f"{r['page_bytes_passed_on'] / 1e6:.1f} MB passed on; {r['model_bytes_sent'] / 1e6:.1f} MB from machine 0", end="")
        else:
            print("       ", end="")
        print(f" peak {r['peak_resident_bytes'] / 1e6:.0f} MB{of_limit(a, r['peak_resident_bytes'])}"
              + (f"; link {8e-6 * r['link_bytes_a_second']:.0f} Mbit/s, {1e3 * r['link_round_trip_seconds']:.1f} ms"
                 if r["link_bytes_a_second"] else ""), flush=True)


def of_limit(a, peak):
    units = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30}
    limit = a.max_memory and (float(a.max_memory[:-1]) * units[a.max_memory[-1].upper()])
    return f", {peak / limit:.2f} of its limit" if limit else ""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trex", required=True)
    parser.add_argument("--triangles", default="1e6")
    parser.add_argument("--machines", default="1,2,4")
    parser.add_argument("--megabits", default="1000,100")
    parser.add_argument("--share", type=float, default=0.4, help="of a core, each machine")
    parser.add_argument("--cache", type=float, default=0.1, help="of the pages' memory, each machine; 0: what --max-memory leaves")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--exact", default="1")
    parser.add_argument("--page-disk", default="auto", help="as of trex render: where unpacked pages are kept")
    parser.add_argument("--model", help="a bundle that is there already, in place of --triangles")
    parser.add_argument("--databases", default="local,central")
    parser.add_argument("--round-robin", action="store_true", help="each job again, with pages in turn")
    parser.add_argument("--max-memory", help="limit of each process, as of trex render")
    parser.add_argument("--by-machine", action="store_true", help="what each machine's time went into")
    parser.add_argument("--kill", help="folder of scripts/openmpi5: what a death costs")
    parser.add_argument("--window", action="store_true", help="a window and a server")
    parser.add_argument("--elsewhere", help="shares of the pages' memory: the window does not have the model")
    parser.add_argument("--edits", type=int, default=20, help="of a window, of each class")
    parser.add_argument("--runs", type=int, default=1, help="medians of so many")
    a = parser.parse_args()
    if os.geteuid() != 0 or not os.access(CPU, os.W_OK) or not all(map(shutil.which, ("mpirun", "ip", "tc", "unshare"))):
        print("machines.py: skipped: needs root, mpirun, ip, tc, unshare and cgroups of version 1")
        return 77
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # what was made is removed then, too
    trex = os.path.abspath(a.trex)
    folder = tempfile.mkdtemp(prefix="trex-machines-")
    environment = {k: os.environ[k] for k in list(os.environ) if k.startswith(("OMPI_", "PMIX_"))}
    for name in environment:
        del os.environ[name]
    os.environ["TREX_OIDN"] = "none"
    counts, machines = [int(x) for x in a.machines.split(",")], None
    try:
        os.mkdir(os.path.join(folder, "cpu"))
        call("mount", "--bind", CPU, os.path.join(folder, "cpu"))
        model = os.path.abspath(a.model) if a.model else os.path.join(folder, "model.trex")
        if not a.model:
            call(trex, "bake", f"synth:assembly?triangles={a.triangles}&seed=3", "-o", model, "--stream", "-q")
        if a.window:
            print(f"{a.model or a.triangles + ' triangles'}; window {a.size}, {a.spp} samples, --exact {a.exact}; each machine {a.share} of a core")
            window(a, trex, folder, model)
            return 0
        pages = json.loads(call(trex, "info", model, "--json").stdout)["mesh_pages"]
        cache = max(int(pages["memory_bytes"] * a.cache), pages["largest_page_bytes"] + 8192)
        print(f"{a.model or a.triangles + ' triangles'}, {os.path.getsize(model) / 1e6:.1f} MB; {a.size}, {a.spp} samples, --exact {a.exact}; each machine "
              f"{a.share} of a core and {f'{cache / 1e6:.1f} MB' if a.cache else f'what {a.max_memory} leave'} of pages")
        job = [model, "--size", a.size, "--spp", a.spp, "--exact", a.exact, "--device", "none", "--denoise", "off", "--threads", 1,
               *(["--cache", cache] if a.cache else []), "--page-disk", a.page_disk, "--json"]
        if a.kill:
            kill_one(a, trex, folder, job)
            return 0
        if a.max_memory:
            job += ["--max-memory", a.max_memory]
        print(HEAD)
        first = alone = None
        for megabits in a.megabits.split(","):
            for count in counts:
                if count == 1 and alone:  # it has no use for links
                    continue
                machines = Machines(count, megabits, a.share, folder)
                for database in a.databases.split(",") if count > 1 else ("-",):
                    planned = None
                    for order in ("plan", "round-robin") if a.round_robin and count > 1 else ("plan",):
                        reports, before = [], resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
                        for _ in range(a.runs):
                            out = os.path.join(folder, "a.exr")
                            options = ["--scene-db", database, "--page-order", order] if count > 1 else []
                            reports.append(machines.run(trex, [*job, "-o", out, *options]))
                            with open(out, "rb") as f:
                                picture = f.read()
                            first = first or picture
                            if picture != first:
                                sys.exit(f"{count} machines, {database}: another picture")
                        seconds = statistics.median(r["render_seconds"] for r in reports)
                        alone, planned = alone or seconds, planned or seconds
                        used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
                        tell(a, megabits, count, database, seconds, alone, reports[-1], used)
                        if order != "plan":
                            print(f"     that was with pages in turn: {seconds / planned:.2f} of the seconds as planned (bar 1.5)", flush=True)
                machines.remove()
    finally:
        if machines:
            machines.remove()
        call("umount", os.path.join(folder, "cpu"), check=False)
        shutil.rmtree(folder, ignore_errors=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

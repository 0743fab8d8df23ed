#!/usr/bin/env python3
"""Simulates fields that are too large for our machines: building one with many workers that fail,
and many viewers of one on a static host.

  benchmarks/at_scale.py [--help]

Options give the cost of a worker and of a view; their help names the programs that measured the
defaults. Failures and views come from a seeded random generator, so a run prints the same numbers
again. For 10^12 slabs and 1,000 workers it prints, by the number of shards, the time of the build
with and without failures, and the share of the work that is wasted; and the time of a merge. For
100,000 viewers it prints requests, bytes, and the hit rate of a cache between them and the host.
"""

import argparse
import collections
import heapq
import random


def build(options, shards):
    """Hours until all shards are done, and the share of the workers' time that was wasted."""
    chance = random.Random(options.seed)
    rays = options.slabs * options.fine_share / shards
    work = rays / options.slabs_per_second  # seconds of a shard
    mean_life = options.hours_between_failures * 3600
    # A worker fails at random moments, and is away for a while; its task goes back to the queue.
    waiting = collections.deque([work] * shards)
    events = [(0.0, worker) for worker in range(options.workers)]  # when a worker is free
    heapq.heapify(events)
    end = wasted = 0.0
    while events:
        now, worker = heapq.heappop(events)
        if not waiting:
            continue
        left = waiting.popleft()
        life = chance.expovariate(1 / mean_life)
        needed = options.start_seconds + left
        if life >= needed:
            end = max(end, now + needed)
            wasted += options.start_seconds
            heapq.heappush(events, (now + needed, worker))
            continue
        # Committed tiles stay, and another worker continues the task from there.
        computed = max(0.0, life - options.start_seconds)
        kept = computed // options.commit_seconds * options.commit_seconds
        waiting.append(left - kept)
        wasted += life - kept
        heapq.heappush(events, (now + life + options.away_seconds, worker))
        if not events:
            break
    total = work * shards
    return end / 3600, wasted / total


def print_build(options):
    fine = options.slabs * options.fine_share / options.slabs_per_second / options.workers / 3600
    coarse = options.slabs * (options.work - options.fine_share) / options.slabs_per_second
    print(f"building {options.slabs:.0e} slabs on {options.workers} workers of "
          f"{options.slabs_per_second / 1e6:g} M slabs/s, each failing every "
          f"{options.hours_between_failures:g} h:")
    print(f"  coarse levels, built before in the same way: {coarse / options.workers / 3600:.2f} h")
    print(f"  the finest level without any failure: {fine:.2f} h")
    print("  shards   hours each   hours in all   beside the best   wasted work")
    for factor in (1, 2, 4, 16, 64, 256):
        shards = options.workers * factor
        hours, wasted = build(options, shards)
        print(f"  {shards:6}   {fine / factor:10.2f}   {hours:12.2f}   {hours / fine:15.2f}"
              f"   {100 * wasted:9.2f} %")
    size = options.slabs * options.bytes_per_slab * 16 / 15
    print(f"  merge of {size / 1e9:.0f} GB at {options.merge_bytes_per_second / 1e6:g} MB/s: "
          f"{size / options.merge_bytes_per_second / 3600:.2f} h")


class Cache:
    """A cache for all viewers of a region. It evicts the least recently used ranges."""

    def __init__(self, limit):
        self.limit, self.bytes, self.ranges = limit, 0, collections.OrderedDict()

    def get(self, name, size):
        if name in self.ranges:
            self.ranges.move_to_end(name)
            return True
        self.ranges[name] = size
        self.bytes += size
        while self.bytes > self.limit:
            self.bytes -= self.ranges.popitem(last=False)[1]
        return False


def ranges_of(options, level):
    total = options.slabs * options.bytes_per_slab / 16 ** (options.levels - level)
    return max(options.view_ranges, int(total / options.range_bytes))


def view(options, place, level):
    """The ranges that a view needs of the level that matches its pixels. Each level needs the same
    number, because pictures have the same number of pixels. They are neighbours, at a place from 0
    to 1 that depends on the eye."""
    count = ranges_of(options, level)
    begin = int(place * count)
    return [(level, (begin + k) % count) for k in range(options.view_ranges)]


def print_views(options):
    chance = random.Random(options.seed)
    sample = min(options.viewers, options.viewers_simulated)
    print(f"{options.viewers} viewers of {options.views} views each, pictures of about a million "
          f"pixels ({sample} simulated):")
    for gigabytes in options.cache_gigabytes:
        cache = Cache(gigabytes * 1e9)
        requests = hits = 0
        for _ in range(sample):
            # Every viewer begins with the default view and the coarse levels, which come first.
            names = [(level, k) for level in range(options.view_level)
                     for k in range(min(options.view_ranges, ranges_of(options, level)))]
            seen = set()
            place = 0.0
            step = options.view_move * options.view_ranges / ranges_of(options, options.view_level)
            for number in range(options.views):
                place = (place + chance.gauss(0, step)) % 1
                close = chance.random() < options.close_views
                level = options.view_level + (chance.randrange(1, 3) if close else 0)
                found = view(options, place, min(level, options.levels))
                for name in (names if number == 0 else []) + found:
                    if name in seen:
                        continue
                    seen.add(name)
                    requests += 1
                    hits += cache.get(name, options.range_bytes)
        of_all = options.viewers / sample
        each = requests / sample
        print(f"  cache of {gigabytes:g} GB: {each:.0f} requests and "
              f"{each * options.range_bytes / 1e6:.1f} MB a viewer, {100 * hits / requests:.1f} % of "
              f"them from the cache; the host answers at most "
              f"{(requests - hits) * of_all / 1e6:.1f} M requests, "
              f"{(requests - hits) * options.range_bytes * of_all / 1e12:.2f} TB")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--slabs", type=float, default=1e12, help="of the finest level")
    parser.add_argument("--levels", type=int, default=5, help="finest level")
    parser.add_argument("--work", type=float, default=1.27,
                        help="rays of all levels for a slab of the finest (filtered levels take 4)")
    parser.add_argument("--fine-share", type=float, default=1.0, help="of them, the finest level's")
    parser.add_argument("--bytes-per-slab", type=float, default=0.2, help="slf info, predictive:90")
    parser.add_argument("--workers", type=int, default=1000)
    parser.add_argument("--slabs-per-second", type=float, default=1e6,
                        help="of a worker, slf build")
    parser.add_argument("--hours-between-failures", type=float, default=50, help="of a worker")
    parser.add_argument("--away-seconds", type=float, default=600, help="after a failure")
    parser.add_argument("--start-seconds", type=float, default=30,
                        help="queue, and reading the volume")
    parser.add_argument("--commit-seconds", type=float, default=1)
    parser.add_argument("--merge-bytes-per-second", type=float, default=500e6,
                        help="benchmarks/many_machines.py")
    parser.add_argument("--viewers", type=int, default=100_000)
    parser.add_argument("--viewers-simulated", type=int, default=10_000)
    parser.add_argument("--views", type=int, default=50, help="of a viewer")
    parser.add_argument("--view-level", type=int, default=3, help="that matches the pixels")
    parser.add_argument("--view-ranges", type=int, default=60,
                        help="of the level that matches the pixels, in a view: slf measure")
    parser.add_argument("--view-move", type=float, default=0.3,
                        help="share of a view's ranges that the next view replaces, about")
    parser.add_argument("--close-views", type=float, default=0.1,
                        help="share of the views that need one of the two next finer levels")
    parser.add_argument("--range-bytes", type=int, default=65536, help="of a request")
    parser.add_argument("--cache-gigabytes", type=float, nargs="*", default=[0.1, 1, 10])
    options = parser.parse_args()
    print_build(options)
    print_views(options)


if __name__ == "__main__":
    main()

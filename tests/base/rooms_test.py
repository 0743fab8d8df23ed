"""Rooms include only what ARCHITECTURE.md lets them: its table of rooms, beside every #include."""
import pathlib
import re
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
# The rooms of public headers, which stand in one folder.
PUBLIC = {
    'base': 'error progress tone',
    'image': 'image',
    'field/geometry': 'tile shape camera',
    'field/reveal': 'reveal',
    'field': 'field',
    'field/tiles': 'tile_reader',
    'field/render': 'render player',
    'field/scene': 'scene',
    'field/write': 'build merge repack verify',
    'field/inspect': 'inspect',
    'field/remote': 'remote',
    'field/measure': 'measure',
    'source/volume': 'volume volume_parts',
    'source/transfer': 'transfer',
    'source/light': 'light',
    'source/raycast': 'raycaster path_tracer cut',
    'source/mesh': 'mesh',
    'source/pictures': 'pictures',
    'source/recipe': 'recipe',
}
ROOM_OF_HEADER = {f'slf/{name}.h': room for room, names in PUBLIC.items() for name in names.split()}
# Types without functions, which every room may use.
COMMON = {'slf/tile.h', 'slf/shape.h', 'slf/tone.h', 'slf/image.h', 'slf/camera.h'}


def read_table():
    uses = {}
    for line in (ROOT / 'ARCHITECTURE.md').read_text().splitlines():
        row = re.match(r'\| `([\w/]+)` \| ([^|]*)\|', line)
        if row and (ROOT / row[1]).is_dir() and row[1] not in uses:
            uses[row[1]] = 'all' if row[2].strip() == 'all' else re.findall(r'`([\w/]+)`', row[2])
    return uses


def closure(uses, room):
    if uses[room] == 'all':
        return set(uses)
    found = {room}
    for used in uses[room]:
        found |= closure(uses, used)
    return found


def room_of(path, rooms):
    for parent in pathlib.PurePosixPath(path).parents:
        if str(parent) in rooms:
            return str(parent)
    return None


def main():
    uses = read_table()
    allowed = {room: closure(uses, room) for room in uses}
    wrong = []
    files = [file for top in {room.split('/')[0] for room in uses}
             for file in (ROOT / top).rglob('*') if file.suffix in ('.cc', '.h')]
    for file in files + list((ROOT / 'include/slf').glob('*.h')):
        path = file.relative_to(ROOT).as_posix()
        room = ROOM_OF_HEADER.get(path.removeprefix('include/')) or room_of(path, uses)
        if room is None:
            wrong.append(f'{path} belongs to no room of ARCHITECTURE.md')
            continue
        for header in re.findall(r'#include [<"]([\w/.-]+/[\w/.-]+)[>"]', file.read_text()):
            if header in COMMON:
                continue
            other = ROOM_OF_HEADER.get(header) or (
                room_of(header, uses) if (ROOT / header).exists() else None)
            if header.startswith('slf/') and other is None:
                wrong.append(f'{header} belongs to no room of {pathlib.Path(__file__).name}')
            elif other and other not in allowed[room]:
                wrong.append(f'{path} includes {header}, but `{room}` does not use `{other}`')
    if len(files) < 100:
        wrong.append(f'only {len(files)} sources found')
    print('\n'.join(sorted(set(wrong))) or f'{len(files)} sources in {len(uses)} rooms')
    return bool(wrong)


sys.exit(main())

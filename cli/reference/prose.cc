#include "cli/reference/prose.h"

#include <stdexcept>

namespace slf::cli::reference {
namespace {

const std::vector<Prose>& all() {
  static const std::vector<Prose> texts{
      {"",
       {"A sphere light field stores the colour of every ray that crosses a sphere around an "
        "object, indexed by where the ray enters and where it leaves. Any view from outside is "
        "then a look-up whose cost does not depend on the volume.",
        "slf builds such fields from volumes (NIfTI, NRRD, MetaImage, DICOM series, raw), stores "
        "them in one file of small compressed tiles, and draws views within a given amount of "
        "memory, however large the file is.",
        "Commands that only read a field take the address of one on a web server, too: "
        "https://HOST/F.slf. If the server does not serve parts of files (HTTP ranges), a field of "
        "at most 64 MiB is fetched whole. What is read stays in a temporary file (in TMPDIR) until "
        "the command ends; --json says how many requests and bytes it took.",
        "Results go to standard output, progress and messages to standard error."},
       {{"Build a field and draw a view of it",
         "slf build head.nii.gz -o head.slf && slf render head.slf -o view.png"},
        {"Without a volume at hand", "slf build scene:balls -o balls.slf"},
        {"From a web server", "slf render https://example.org/head.slf -o view.png --stats"}}},
      {"build",
       {"Traces every ray of the field through the volume and stores the result. The size of a "
        "field follows from --entry, --exit and --levels: doubling one of the lattices takes four "
        "times the rays.",
        "A build may be interrupted at any moment. The same command continues it; tiles that were "
        "committed are not traced again.",
        "World coordinates are millimetres, LPS: x to the patient's left, y to the back, z up.",
        "Unless --lighting is direct, the light that reaches places near the surface is computed "
        "first, from a rig of lights and its sky or an environment picture. The field keeps it for "
        "slf-evaluate(1) and for builds that are resumed. A white surface that faces a light of "
        "intensity 1 has radiance 1; --exposure and --tonemap turn radiance into colours. With "
        "--color-type half "
        "the field holds radiance itself, and slf-render(1) has these options."},
       {{"A small field first", "slf build head.nii.gz -o head.slf --levels 1"},
        {"With colours by name", "slf build head.nii.gz -o head.slf --transfer ct-bone"},
        {"With a preset of ParaView",
         "slf build head.nii.gz -o head.slf --transfer presets.json#Viridis"},
        {"Without shadows and scattered light",
         "slf build head.nii.gz -o head.slf --transfer ct-bone --lighting direct"},
        {"From pictures with cameras, every eighth left out",
         "slf build pictures:chair -o chair.slf --holdout 8"},
        {"From a mesh with textures", "slf build model.glb -o model.slf"},
        {"Lossless", "slf build head.nii.gz -o head.slf --codec zstd"},
        {"The third of eight shards, for slf-merge(1)",
         "slf build head.nii.gz -o part-3.slf --shard 3/8"},
        {"Without building coarse levels in every shard: first",
         "slf build head.nii.gz -o coarse.slf --only-levels 0-1"},
        {"and then, on every machine,",
         "slf build head.nii.gz -o part-3.slf --coarser coarse.slf --shard 3/8"},
        {"Headerless voxels",
         "slf build head.raw -o head.slf --dims 128x128x84 --type u8 --spacing 1x1x1.5"}}},
      {"cameras",
       {"Writes cameras in well-spread directions around a sphere, as transforms.json of "
        "instant-ngp: camera space has x to the right, y up, and looks along -z. A renderer fills "
        "in the pictures, and slf-build(1) makes a field of them: pictures:FOLDER."},
       {{"A hundred cameras, and eight for slf-evaluate(1)",
         "slf cameras head.slf --count 100 --test 8 -o transforms.json"},
        {"Pictures with depth from our own ray-caster",
         "slf raycast head.nii.gz --cameras transforms.json -o pictures"}}},
      {"pictures",
       {"Finds the depths of pictures as slf-build(1) does, and draws a contact sheet. Four cells "
        "show each picture: itself; its depth, from yellow (near) to blue, black where it is not "
        "known; how many other pictures confirm this depth, from red to green; and the surface "
        "that the field is built with. Estimated depths are kept for slf-build(1)."},
       {{"Why does the field have holes?", "slf pictures depth photos -o sheet.png"}}},
      {"info",
       {"For a field, prints geometry, levels, codec, sizes and provenance; for a volume, "
        "dimensions, spacing, orientation and the range of its values; for a mesh, its "
        "size, colours and textures; for a folder of several DICOM series, a list of them."},
       {{"Is a field complete?", "slf info head.slf --json | grep complete"},
        {"One of several series", "slf build scans --series 4 -o head.slf"}}},
      {"transfer",
       {"Transfer functions give the values of a volume colours and opacities. Built-in ones have "
        "names; those for CT are in Hounsfield units, the others relative to the range of the "
        "volume's values. Files of ParaView, 3D Slicer and MRIcroGL are read as well."},
       {{"The built-in functions", "slf transfer --list"},
        {"A picture of one", "slf transfer ct-bone -o ct-bone.png"},
        {"One to start from in ParaView", "slf transfer mr-brain -o brain.json"}}},
      {"render",
       {"Draws one view with as many tiles as it needs and no more memory than --memory allows. "
        "Pixels whose tiles are missing are drawn from coarser levels, and a message says how "
        "many."},
       {{"From the front, in a large picture",
         "slf render head.slf -o front.png --orbit 0,0,3 --size 1024x1024"},
        {"Float colours and depths", "slf render head.slf -o view.exr"},
        {"What does the view cost?", "slf render head.slf -o view.png --stats"}}},
      {"pick",
       {"Prints the point of the surface that a picture of slf-render(1) shows at a pixel, its "
        "distance from the eye, and the standard deviation of that. A pixel that is less than half "
        "opaque shows no point."},
       {{"What is in the middle?", "slf pick head.slf --orbit 30,20,3 --size 512 256,256 --json"},
        {"Of many pixels, one X,Y a line", "slf pick head.slf --pixels pixels.txt"}}},
      {"raycast",
       {"Draws the view that slf-render(1) draws from a field, by ray-casting the volume itself. "
        "It is the truth that slf-evaluate(1) compares with."},
       {{"The default view", "slf raycast head.nii.gz -o truth.png"},
        {"Organs in their own colours",
         "slf raycast ct.nii.gz -o organs.png --labels-volume organs.nii.gz --label-table "
         "organs.ctbl"},
        {"Under an overcast sky", "slf raycast head.nii.gz -o sky.png --light-rig overcast"},
        {"By path tracing, as linear radiance",
         "slf raycast head.nii.gz -o truth.exr --reference --samples 1024"}}},
      {"play",
       {"Draws the frames of an orbit or of a path of keyframes when they are due. A loading "
        "thread decodes tiles for the frames ahead; a frame that lacks tiles is drawn from coarser "
        "levels instead of waiting. Prints how many frames were late and how much was drawn at "
        "full level."},
       {{"An orbit, as an animated picture",
         "slf play head.slf --memory 64MiB --preview turn.webp"},
        {"Compare ways of loading, from a cold file",
         "slf play head.slf --cold --loading ahead,demand,wait"}}},
      {"measure",
       {"Draws random views at every level and prints what a view touches: tiles, compressed "
        "bytes, pages of the file, decoded bytes and resident memory."},
       {{"As JSON, for other programs", "slf measure head.slf --json"},
        {"Two modes beside each other", "slf measure head.slf --mode bitri,depth --views 32"}}},
      {"evaluate",
       {"Draws random views from the field and by ray-casting, and prints PSNR and SSIM. Transfer "
        "function and light are those of the field's provenance unless options name others."},
       {{"Every mode has its own quality",
         "slf evaluate head.slf --volume head.nii.gz --mode bitri"}}},
      {"compare",
       {"Compares two pictures of one size. With --min-psnr the exit status says whether they are "
        "alike enough."},
       {{"The differences, enlarged", "slf compare truth.png view.png --diff error.png --gain 8"}}},
      {"repack",
       {"Writes a new field from the tiles of another: with another codec, fewer levels or "
        "subfields. Tiles whose codec stays the same are copied without loss. The input is not "
        "changed."},
       {{"Smaller", "slf repack fine.slf -o small.slf --codec jpeg:60"},
        {"How small would it be?", "slf repack fine.slf --codec predictive:70 --dry-run"},
        {"The first two levels", "slf repack fine.slf -o coarse.slf --levels 1"}}},
      {"merge",
       {"Joins parts of one field: shards of slf-build(1) in any number, levels, or subfields "
        "that slf-repack(1) kept. The file has the bytes that slf-repack(1) writes of a field that "
        "a single build made. Nothing is decoded. Before it writes, it names parts that are "
        "missing, overlap, were not finished, or were built with other settings. slf-repack(1) "
        "encodes subfields of a predictive field anew; merged, they make a field of their own, "
        "without the loss of another encoding."},
       {{"Shards", "slf merge part-*.slf -o head.slf"},
        {"Coarse levels, and shards of the finest one",
         "slf merge coarse.slf part-*.slf -o head.slf"}}},
      {"verify",
       {"Reads the whole file: pages, records, checksums and every tile. With --fix, tiles that "
        "are damaged are dropped; the build command that made the field fills them again."},
       {{"Check after copying", "slf verify head.slf"},
        {"Repair", "slf verify --fix head.slf && slf build head.nii.gz -o head.slf"}}},
      {"ls",
       {"Prints a line for each tile. Tools such as awk, sort and cut read it, and "
        "slf-tile(1) takes its first column. Only the tables of the file's records are read, so "
        "that large fields are listed quickly and in little memory."},
       {{"The ten largest tiles", "slf ls head.slf | sort -t'\t' -k4 -n -r | head"},
        {"How many tiles of level 2 are still missing?",
         "slf ls head.slf.unfinished --level 2 --missing | grep -c missing"}}},
      {"tile",
       {"Decodes one tile and writes it as a picture, or as its plain samples."},
       {{"A tile that slf-verify(1) named", "slf tile head.slf 2/4711 -o tile.png"},
        {"Samples for another program",
         "slf tile head.slf 0/1/6 --channel depth -o - | od -t u1"}}},
      {"diff",
       {"Compares the manifests of two fields and all of their tiles. Tiles with other bytes are "
        "decoded, and the PSNR of their samples is printed."},
       {{"Did a copy, a merge or another machine give the same field?", "slf diff one.slf two.slf"},
        {"Is a smaller field good enough?",
         "slf repack fine.slf -o small.slf --codec predictive:70\nslf diff fine.slf small.slf "
         "--min-psnr 30"}}},
      {"help",
       {"Prints what --help of a command prints, or the list of commands."},
       {{"The options of render", "slf help render"}}},
      {"view",
       {"Shows fields in a browser: turn, zoom and move them with mouse, touch and keys. Prints "
        "the address of the page and serves it until Ctrl-C.",
        "Only this machine reaches the page, unless --bind names another address. The server sends "
        "the named fields and the page, and nothing else."},
       {{"Look around in a field", "slf view head.slf --open"},
        {"For other machines too", "slf view head.slf --bind 0.0.0.0 --port 8000"}}},
      {"export",
       {"Writes a page that shows a field, for people who do not have slf. One file, NAME.html, "
        "opens from disk and needs no network. A folder goes to any host of static files. If the "
        "host serves parts of files (HTTP ranges), only the parts that views need are loaded; "
        "otherwise a field of at most 64 MiB is loaded whole.",
        "The page of a folder also shows fields of other hosts that allow it (CORS): "
        "index.html?field=https://example.org/head.slf",
        "With --max-size, slf tries the field as it is, then qualities 90, 75, 60 and 45 of all "
        "levels, then of one level less, and so on, and writes the first that fits. --codec or "
        "--levels fix one of these."},
       {{"One file to send", "slf export head.slf -o head.html --max-size 20MiB"},
        {"A folder for a web host", "slf export head.slf -o site/"}}},
  };
  return texts;
}

}  // namespace

const Prose& prose(const std::string& command) {
  for (const Prose& text : all())
    if (text.command == command) return text;
  throw std::runtime_error("cli/reference/prose.cc has no text for the command " + command);
}

}  // namespace slf::cli::reference

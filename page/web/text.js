// All texts that a visitor reads, in each language of the page; {0} and {1} are values.

const kLanguages = ['en', 'de', 'fr'];
export const kTexts = {
  // The panel
  settings: ['Settings', 'Einstellungen', 'Réglages'],
  loading: ['Loading…', 'Wird geladen…', 'Chargement…'],
  fold: ['Hide or show the panel (H)', 'Leiste ein- oder ausblenden (H)',
    'Masquer ou afficher le panneau (H)'],
  state: ['State', 'Zustand', 'État'],
  play: ['Play', 'Abspielen', 'Lire'],
  tones: ['Tones', 'Tonwerte', 'Tons'],
  neutral: ['neutral', 'neutral', 'neutre'],
  none: ['none', 'keine', 'aucun'],
  exposure: ['Exposure', 'Belichtung', 'Exposition'],
  background: ['Background', 'Hintergrund', 'Arrière-plan'],
  cutFaces: ['Cut faces', 'Schnittflächen', 'Faces coupées'],
  shaded: ['shaded', 'beleuchtet', 'éclairées'],
  grey: ['grey', 'grau', 'grises'],
  hollow: ['hollow', 'hohl', 'creuses'],
  level: ['Level', 'Stufe', 'Niveau'],
  greyLevel: ['Level', 'Mitte', 'Niveau'],
  window: ['Window', 'Fenster', 'Fenêtre'],
  flip: ['Flip', 'Umdrehen', 'Inverser'],
  snap: ['Snap to axis', 'An Achse', 'Vers un axe'],
  more: ['Add a plane', 'Weitere Ebene', 'Ajouter un plan'],
  remove: ['Remove', 'Entfernen', 'Supprimer'],
  directions: ['Directions', 'Richtungen', 'Directions'],
  spin: ['Turn by itself', 'Von selbst drehen', 'Tourner seul'],
  reset: ['Reset', 'Zurücksetzen', 'Réinitialiser'],
  full: ['Full screen', 'Vollbild', 'Plein écran'],
  measure: ['Measure', 'Messen', 'Mesurer'],
  cut: ['Cut', 'Schneiden', 'Couper'],
  save: ['Save picture', 'Bild speichern', 'Enregistrer'],
  copyLink: ['Copy link', 'Link kopieren', 'Copier le lien'],
  copyView: ['Copy this view', 'Ansicht kopieren', 'Copier la vue'],
  copyNote: ['Copy a note', 'Notiz kopieren', 'Copier une note'],
  // The picture, and what is on it
  picture: ['The field, seen from a camera that you can move',
    'Das Feld, gesehen von einer Kamera, die Sie bewegen können',
    'Le champ, vu par une caméra que vous pouvez déplacer'],
  keys: [`Arrow keys turn the view, plus and minus zoom, Shift with arrow keys moves it, R resets
    it, Space turns it by itself, F fills the screen, H hides the panel, L the list of structures,
    Page Up and Page Down show the saved views, M measures, P plays the states of the object, comma
    and period step through them, C cuts the object by a plane, T plays the saved views, digits look
    along an axis.`,
    `Pfeiltasten drehen die Ansicht, Plus und Minus zoomen, Umschalt mit Pfeiltasten verschiebt sie,
    R setzt sie zurück, Leertaste dreht sie von selbst, F füllt den Bildschirm, H blendet die Leiste
    aus, L die Liste der Strukturen, Bild auf und Bild ab zeigen die gespeicherten Ansichten, M
    misst, P spielt die Zustände des Objekts ab, Komma und Punkt schalten sie weiter, C schneidet
    das Objekt mit einer Ebene, T spielt die gespeicherten Ansichten ab, Ziffern sehen entlang einer
    Achse.`,
    `Les flèches tournent la vue, plus et moins zooment, Maj avec les flèches la déplace, R la
    réinitialise, Espace la fait tourner seule, F remplit l’écran, H masque le panneau, L la liste
    des structures, Page haut et Page bas montrent les vues enregistrées, M mesure, P fait défiler
    les états de l’objet, virgule et point passent de l’un à l’autre, C coupe l’objet par un plan, T
    fait défiler les vues enregistrées, les chiffres montrent un côté.`],
  planes: ['Planes that cut the object', 'Ebenen, die das Objekt schneiden',
    'Plans qui coupent l’objet'],
  plane: [`Plane {0}: arrow keys move it, with Shift they tilt it, Home snaps it to an axis, Enter
    flips it, Delete removes it`,
    `Ebene {0}: Pfeiltasten verschieben sie, mit Umschalt neigen sie sie, Pos 1 richtet sie an einer
    Achse aus, Eingabe dreht sie um, Entf entfernt sie`,
    `Plan {0} : les flèches le déplacent, avec Maj elles l’inclinent, Origine l’aligne sur un axe,
    Entrée l’inverse, Suppr le supprime`],
  seen: ['{0}, seen from azimuth {1}°, elevation {2}°, {3} radii away',
    '{0}, gesehen von Azimut {1}°, Höhe {2}°, {3} Radien entfernt',
    '{0}, vu de l’azimut {1}°, élévation {2}°, à {3} rayons'],
  seenState: ['state {0}', 'Zustand {0}', 'état {0}'],
  seenParts: ['structures {0}', 'Strukturen {0}', 'structures {0}'],
  mark: ['Click a point of the surface, or press Enter for the one in the middle.',
    'Klicken Sie auf einen Punkt der Oberfläche; Eingabe nimmt den in der Mitte.',
    'Cliquez sur un point de la surface ; Entrée prend celui du milieu.'],
  ruler: ['Click two points of the surface, or press Enter for the one in the middle.',
    'Klicken Sie auf zwei Punkte der Oberfläche; Eingabe nimmt den in der Mitte.',
    'Cliquez sur deux points de la surface ; Entrée prend celui du milieu.'],
  nothing: ['Nothing opaque is there.', 'Dort ist nichts Undurchsichtiges.',
    'Il n’y a rien d’opaque à cet endroit.'],
  distance: ['Distance: {0}', 'Abstand: {0}', 'Distance : {0}'],
  units: [' units of the volume', ' Einheiten des Volumens', ' unités du volume'],
  scale: ['Scale: the bar is {0} long', 'Maßstab: Der Balken ist {0} lang',
    'Échelle : la barre mesure {0}'],
  scaleAt: ['{0}, on the surface in the middle', '{0}, auf der Oberfläche in der Mitte',
    '{0}, sur la surface au milieu'],
  drag: ['Drag to turn · wheel to zoom · Shift and drag to move',
    'Ziehen dreht · das Rad zoomt · Ziehen mit Umschalt verschiebt',
    'Glissez pour tourner · molette pour zoomer · Maj pour déplacer'],
  touch: ['Drag to turn · pinch to zoom · two fingers move it',
    'Ziehen dreht · zwei Finger zoomen und verschieben',
    'Glissez pour tourner · deux doigts pour zoomer et déplacer'],
  side: ['Look from {0} ({1})', 'Von {0} aus sehen ({1})', 'Vue depuis {0} ({1})'],
  // Structures
  structures: ['Structures', 'Strukturen', 'Structures'],
  listOf: ['List of structures', 'Liste der Strukturen', 'Liste des structures'],
  unroll: ['Hide or show the list (L)', 'Liste ein- oder ausblenden (L)',
    'Masquer ou afficher la liste (L)'],
  allOn: ['All on', 'Alle ein', 'Tout afficher'],
  allOff: ['All off', 'Alle aus', 'Tout masquer'],
  find: ['Find', 'Suchen', 'Chercher'],
  findParts: ['Find structures', 'Strukturen suchen', 'Chercher des structures'],
  show: ['Show {0}', '{0} zeigen', 'Montrer {0}'],
  only: ['Only', 'Nur', 'Seul'],
  onlyOne: ['Only {0}', 'Nur {0}', '{0} seul'],
  opacity: ['Opacity of {0}', 'Deckkraft von {0}', 'Opacité de {0}'],
  tint: ['Tint of {0}', 'Tönung von {0}', 'Teinte de {0}'],
  tints: ['Tint: multiplies the colours', 'Tönung: multipliziert die Farben',
    'Teinte : multiplie les couleurs'],
  of: ['{0} of {1}', '{0} von {1}', '{0} sur {1}'],
  noStructure: ['This field has no structure named {0}.', 'Dieses Feld hat keine Struktur {0}.',
    'Ce champ n’a pas de structure {0}.'],
  // Saved views
  views: ['Saved views', 'Gespeicherte Ansichten', 'Vues enregistrées'],
  tour: ['Play the tour', 'Rundgang abspielen', 'Lire la visite'],
  pageUp: ['Page Up', 'Bild auf', 'Page haut'],
  pageDown: ['Page Down', 'Bild ab', 'Page bas'],
  previous: ['Previous view', 'Vorige Ansicht', 'Vue précédente'],
  next: ['Next view', 'Nächste Ansicht', 'Vue suivante'],
  noView: ['There is no saved view {0}.', 'Es gibt keine gespeicherte Ansicht {0}.',
    'Il n’y a pas de vue enregistrée {0}.'],
  noViews: ['{0} cannot be loaded.', '{0} kann nicht geladen werden.',
    '{0} ne peut pas être chargé.'],
  title: ['Title', 'Titel', 'Titre'],
  label: ['Label', 'Name', 'Nom'],
  linkCopied: ['The link is on the clipboard.', 'Der Link ist in der Zwischenablage.',
    'Le lien est dans le presse-papiers.'],
  viewCopied: ['This view is on the clipboard, for views.json.',
    'Diese Ansicht ist in der Zwischenablage, für views.json.',
    'Cette vue est dans le presse-papiers, pour views.json.'],
  noteCopied: ['The note is on the clipboard, for views.json.',
    'Die Notiz ist in der Zwischenablage, für views.json.',
    'La note est dans le presse-papiers, pour views.json.'],
  // About the data
  about: ['About the data', 'Zu den Daten', 'À propos'],
  source: ['Source', 'Quelle', 'Source'],
  kind: ['Kind', 'Art', 'Type'],
  voxels: ['Voxels', 'Voxel', 'Voxels'],
  colours: ['Colours', 'Farben', 'Couleurs'],
  shows: ['Shows', 'Zeigt', 'Montre'],
  mip: ['maximum intensity projection', 'Maximumintensitätsprojektion',
    'projection d’intensité maximale'],
  minip: ['minimum intensity projection', 'Minimumintensitätsprojektion',
    'projection d’intensité minimale'],
  mean: ['mean intensity projection', 'Mittelwertprojektion', 'projection d’intensité moyenne'],
  lattice: ['Lattice', 'Gitter', 'Réseau'],
  sides: ['{0} entry, {1} exit', '{0} Eintritt, {1} Austritt', '{0} entrée, {1} sortie'],
  levels: ['Levels', 'Stufen', 'Niveaux'],
  samples: ['Samples', 'Abtastwerte', 'Échantillons'],
  sphere: ['Sphere', 'Kugel', 'Sphère'],
  radius: ['radius {0}', 'Radius {0}', 'rayon {0}'],
  file: ['File', 'Datei', 'Fichier'],
  loaded: ['Loaded', 'Geladen', 'Chargé'],
  tiles: ['Tiles', 'Kacheln', 'Tuiles'],
  rate: ['Frames a second', 'Bilder je Sekunde', 'Images par seconde'],
  mode: ['Mode', 'Modus', 'Mode'],
  auto: ['auto', 'auto', 'auto'],
  close: ['Close', 'Schließen', 'Fermer'],
  // What happens
  damaged: ['{0} damaged tiles: coarser ones stand in. slf verify says more.',
    '{0} beschädigte Kacheln: Gröbere vertreten sie. slf verify sagt mehr.',
    '{0} tuiles endommagées, remplacées par de plus grossières. Détails : slf verify.'],
  tooFine: ['Levels above {0} of this field are too fine for the page.',
    'Die Stufen über {0} dieses Feldes sind zu fein für die Seite.',
    'Les niveaux au-delà de {0} de ce champ sont trop fins pour la page.'],
  whole: ['This host serves only whole files. Fetched {0}',
    'Dieser Server liefert nur ganze Dateien. Geladen: {0}',
    'Ce serveur n’envoie que des fichiers entiers. Reçu : {0}'],
  waiting: ['Waiting for the network…', 'Warten auf das Netz…', 'En attente du réseau…'],
  lost: ['The graphics card was reset; waiting for it.',
    'Die Grafikkarte wurde zurückgesetzt; die Seite wartet auf sie.',
    'La carte graphique a été réinitialisée ; la page l’attend.'],
  choose: [`A page from disk may not read the files beside it. Choose <b>field.slf</b> in the folder
    of this page:`,
    `Eine Seite von der Festplatte darf die Dateien daneben nicht lesen. Wählen Sie <b>field.slf</b>
    im Ordner dieser Seite:`,
    `Une page ouverte depuis le disque ne peut pas lire les fichiers voisins. Choisissez
    <b>field.slf</b> dans le dossier de cette page :`],
  field: ['Field', 'Feld', 'Champ'],
  // What is wrong
  noPart: ['A part of this page cannot be loaded: {0}.',
    'Ein Teil dieser Seite kann nicht geladen werden: {0}.',
    'Une partie de cette page ne peut pas être chargée : {0}.'],
  tooOld: ['This browser is too old or locked down: it lacks {0}.',
    'Dieser Browser ist zu alt oder zu eingeschränkt: Ihm fehlt {0}.',
    'Ce navigateur est trop ancien ou bridé : il lui manque {0}.'],
  noWasm: [`The host of this page forbids WebAssembly. Its Content-Security-Policy must have
    'wasm-unsafe-eval' in script-src.`,
    `Der Server dieser Seite verbietet WebAssembly. Seine Content-Security-Policy braucht
    'wasm-unsafe-eval' in script-src.`,
    `Le serveur de cette page interdit WebAssembly. Sa Content-Security-Policy doit avoir
    'wasm-unsafe-eval' dans script-src.`],
  noWebGl: [`This browser has no WebGL 2. A current Chrome, Edge, Firefox or Safari has; it may be
    switched off in the settings.`,
    `Dieser Browser hat kein WebGL 2. Aktuelle Chrome, Edge, Firefox und Safari haben es; vielleicht
    ist es in den Einstellungen ausgeschaltet.`,
    `Ce navigateur n’a pas WebGL 2. Chrome, Edge, Firefox et Safari récents l’ont ; il est peut-être
    désactivé dans les réglages.`],
  ownOnly: ['slf view shows only its own fields; the page of slf export shows others.',
    'slf view zeigt nur eigene Felder; die Seite von slf export zeigt andere.',
    'slf view ne montre que ses champs ; la page de slf export en montre d’autres.'],
  noSrc: ['<slf-field> needs an attribute src: the address of a field.',
    '<slf-field> braucht ein Attribut src: die Adresse eines Feldes.',
    '<slf-field> a besoin d’un attribut src : l’adresse d’un champ.'],
  noAddress: ['{0}: not an address', '{0}: keine Adresse', '{0} : pas une adresse'],
  changed: ['The field has changed on its host. Reload the page.',
    'Das Feld hat sich auf dem Server geändert. Laden Sie die Seite neu.',
    'Le champ a changé sur son serveur. Rechargez la page.'],
  noRanges: [`The host of this field does not serve parts of files (HTTP ranges). Reload the page.`,
    `Der Server dieses Feldes liefert keine Teile von Dateien (HTTP-Ranges). Laden Sie die Seite
    neu.`,
    `Le serveur de ce champ n’envoie pas de parties de fichiers (HTTP ranges). Rechargez la page.`],
  tooLarge: [`The host of this field does not serve parts of files (HTTP ranges). Without them, a
    field of at most 64 MiB is fetched whole, and this one is larger. Use another host, slf view, or
    slf export --max-size.`,
    `Der Server dieses Feldes liefert keine Teile von Dateien (HTTP-Ranges). Ohne sie wird ein Feld
    bis 64 MiB ganz geladen. Nehmen Sie einen anderen Server, slf view oder slf export --max-size.`,
    `Le serveur de ce champ n’envoie pas de parties de fichiers (HTTP ranges). Sans elles, un champ
    de 64 MiB au plus est chargé en entier. Prenez un autre serveur, slf view ou slf export
    --max-size.`],
  cutShort: ['The host cut an answer short.', 'Der Server hat eine Antwort abgebrochen.',
    'Le serveur a interrompu une réponse.'],
  empty: ['The field is empty.', 'Das Feld ist leer.', 'Le champ est vide.'],
  noLength: [`The host does not tell how long the field is. It must show the header Content-Range
    (CORS: Access-Control-Expose-Headers).`,
    `Der Server sagt nicht, wie lang das Feld ist. Nötig ist der Header Content-Range (CORS:
    Access-Control-Expose-Headers).`,
    `Le serveur ne dit pas la longueur du champ. Il faut l’en-tête Content-Range (CORS :
    Access-Control-Expose-Headers).`],
  notThere: ['The field is not there (404).', 'Das Feld ist nicht da (404).',
    'Le champ est introuvable (404).'],
  answered: ['The host answered {0}.', 'Der Server antwortete {0}.', 'Le serveur a répondu {0}.'],
  silent: ['The host does not answer.', 'Der Server antwortet nicht.', 'Le serveur ne répond pas.'],
  insecure: ['A page from https may not read a field from http ({0}).',
    'Eine Seite von https darf kein Feld von http lesen ({0}).',
    'Une page en https ne peut pas lire un champ en http ({0}).'],
  noCors: [`{0} does not answer, or does not let this page read the field. It must send the header
    Access-Control-Allow-Origin: {1} (CORS): {2}.`,
    `{0} antwortet nicht oder lässt diese Seite das Feld nicht lesen. Nötig ist der Header
    Access-Control-Allow-Origin: {1} (CORS): {2}.`,
    `{0} ne répond pas ou ne laisse pas cette page lire le champ. Il faut l’en-tête
    Access-Control-Allow-Origin: {1} (CORS) : {2}.`],
  otherHost: ['the page is from another host', 'die Seite ist von einem anderen Server',
    'la page vient d’un autre serveur'],
  inSandbox: ['the page is in a sandbox', 'die Seite ist in einer Sandbox',
    'la page est dans un bac à sable'],
  noEnd: ['The field is damaged: its trees have no end.',
    'Das Feld ist beschädigt: Seine Bäume haben kein Ende.',
    'Le champ est endommagé : ses arbres n’ont pas de fin.'],
  level0: ['Level 0 of this field is too fine for the page.',
    'Die Stufe 0 dieses Feldes ist zu fein für die Seite.',
    'Le niveau 0 de ce champ est trop fin pour la page.'],
  largeTiles: ['The tiles of this field are too large for this graphics card.',
    'Die Kacheln dieses Feldes sind zu groß für diese Grafikkarte.',
    'Les tuiles de ce champ sont trop grandes pour cette carte graphique.'],
  worker: ['A worker failed.', 'Ein Worker ist gescheitert.', 'Un worker a échoué.'],
  hollowParts: ['Cuts through structures are hollow.', 'Schnitte durch Strukturen sind hohl.',
    'Les coupes de structures sont creuses.'],
  noReveal: ['This field has no reveal: its cuts are hollow.',
    'Dieses Feld hat keinen Aufschluss: Seine Schnitte sind hohl.',
    'Ce champ n’a pas d’intérieur enregistré : ses coupes sont creuses.'],
};

// A function that says texts by their names, in the language that is asked for, or else in one that
// the browser's user prefers.
export function speaker(wanted) {
  const language = [wanted, ...globalThis.navigator?.languages ?? []]
    .map((one) => one?.slice(0, 2).toLowerCase()).find((one) => kLanguages.includes(one)) ?? 'en';
  const at = kLanguages.indexOf(language);
  // Numbers have the decimal sign of the language; lists are texts, too.
  const written = (value, digits) => Array.isArray(value) ? say(...value)
    : typeof value !== 'number' ? value : value.toLocaleString(language, {
      useGrouping: false, minimumFractionDigits: digits, maximumFractionDigits: digits ?? 9});
  const say = (name, ...values) =>
    kTexts[name][at].replace(/\n */g, ' ').replace(/\{(\d)\}/g, (_, i) => written(values[i]));
  return Object.assign(say, {language, written});
}

// An error that the element says in its language. For scripts it is English.
export class Told extends Error {
  constructor(name, ...values) {
    super(speaker('en')(name, ...values));
    Object.assign(this, {said: [name, ...values]});
  }
}

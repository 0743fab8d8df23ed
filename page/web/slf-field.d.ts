/** A point of the surface, in world units. */
export interface Pick {
  point: [number, number, number];
  /** Its distance from the eye. */
  depth: number;
  /** The standard deviation of the depth. */
  uncertainty: number;
}

/** How the element behaves: attributes with these names, with dashes, and properties. */
export interface Habits {
  /** Turns slowly after `autoRotateDelay` milliseconds without use; not where motion is reduced. */
  autoRotate: boolean;
  autoRotateDelay: number;
  /** Degrees. */
  rotationPerSecond: number;
  /** What bounds zooming, in radii of the field's sphere; views that are given may be beyond. */
  minDistance: number;
  maxDistance: number;
  /** What bounds turning, in degrees. */
  minElevation: number;
  maxElevation: number;
  disableZoom: boolean;
  disablePan: boolean;
  /** `none`: the picture alone. */
  controls: string;
  /** `none`: no hint for first visitors. */
  interactionPrompt: string;
  /** Plays the saved views one after another; the number of seconds for each. */
  tour: string | boolean;
}

export interface SlfFieldEventMap {
  ready: CustomEvent<null>;
  /** How much has come of the first view: 0 to 1. */
  progress: CustomEvent<{totalProgress: number}>;
  camera: CustomEvent<{view: string}>;
  /** Other properties that changed. */
  change: CustomEvent<{names: string[]}>;
  pick: CustomEvent<Pick>;
  error: CustomEvent<{message: string, error: unknown}>;
}

/**
 * `<slf-field src="field.slf" poster="poster.jpg" view="30,20,3" views="views.json">`, and for a
 * field of structures `structures="left lobe,stem:0.3:#ffd0b0"`, where %2C is a comma of a name.
 */
export interface SlfField extends Habits {
  addEventListener<K extends keyof SlfFieldEventMap>(
    type: K, listener: (this: SlfField, event: SlfFieldEventMap[K]) => void,
    options?: boolean | AddEventListenerOptions): void;
  addEventListener(type: string, listener: EventListenerOrEventListenerObject,
                   options?: boolean | AddEventListenerOptions): void;
}
export class SlfField extends HTMLElement {
  /**
   * Turns the camera to "azimuth,elevation,distance", perhaps with a target: degrees, and radii of
   * the field's sphere. Resolves when it is there.
   */
  flyTo(view: string): Promise<void>;
  /** The address of the field. Another one begins anew, as do changes of the attribute. */
  get src(): string | null;
  set src(address: string);
  /**
   * The field's bytes from anywhere, in place of `src`; set before the element is in a page. `read`
   * gives those from `begin` to before `end`.
   */
  source?: {size: number, read(begin: number, end: number): Promise<Uint8Array>};
  /** The view that is shown, as flyTo() takes it. */
  get view(): string;
  set view(shown: string);
  /** The state of the object that is shown, by its name; takes its number, too. */
  get state(): string | undefined;
  set state(shown: string | number);
  /**
   * The structures that are shown: NAME[:OPACITY][:#RRGGBB] each, as slf render --structure takes
   * them. Also takes one text, as the attribute has it.
   */
  get structures(): string[];
  set structures(shown: string[] | string);
  /**
   * The planes that cut the object, "X,Y,Z,NX,NY,NZ" each, as slf render --clip takes them: a point
   * in world units, and a normal to what is removed. Also takes lists of six numbers, and one text
   * with semicolons in between, as the attribute has it.
   */
  get clip(): string[];
  set clip(planes: string[] | number[][] | string);
  /**
   * What their faces show, as slf render --cap takes it: "shaded", "slice:LO,HI", "hollow"; empty:
   * shaded if the field has a reveal, else hollow.
   */
  get cap(): string;
  set cap(shown: string);
  /** Marks a point, in world units; null: none. */
  set mark(point: [number, number, number] | null);
  /** What is shown, as a picture of this media type; default: image/png. */
  picture(type?: string): Promise<Blob>;
  /** What a place of the element shows, in CSS pixels; null where nothing opaque is shown. */
  pick(x: number, y: number): Pick | null;
}

/** What JSX and templates may set. */
export type SlfFieldAttributes = Partial<Habits> & {
  src?: string, poster?: string, views?: string, view?: string, state?: string | number,
  structures?: string | string[], clip?: string | string[] | number[][], cap?: string,
};

declare global {
  interface HTMLElementTagNameMap {
    'slf-field': SlfField;
  }
}

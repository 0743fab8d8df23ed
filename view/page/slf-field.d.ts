/** A point of the surface, in world units. */
export interface Pick {
  point: [number, number, number];
  /** Its distance from the eye. */
  depth: number;
  /** The standard deviation of the depth. */
  uncertainty: number;
}

/**
 * `<slf-field src="field.slf" poster="poster.jpg" view="30,20,3" views="views.json">`
 *
 * Events: `ready`, `camera` (detail: `{view}`), `pick` (detail: Pick), `error` (detail:
 * `{message}`).
 */
export class SlfField extends HTMLElement {
  /**
   * Turns the camera to "azimuth,elevation,distance", perhaps with a target: degrees, and radii of
   * the field's sphere. Resolves when it is there.
   */
  flyTo(view: string): Promise<void>;
  /** What is shown, as a picture of this media type; default: image/png. */
  picture(type?: string): Promise<Blob>;
  /** What a place of the element shows, in CSS pixels; null where nothing opaque is shown. */
  pick(x: number, y: number): Pick | null;
}

declare global {
  interface HTMLElementTagNameMap {
    'slf-field': SlfField;
  }
}

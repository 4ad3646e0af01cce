// Reads the sections of batches and geometry blobs, and checks every length before it is used.

/** Says what is wrong with received bytes. Decoders throw it, and their callers catch it at one place. */
export class BadBytes extends Error {}

export interface Section {
  kind: number;
  count: number;
  /** The first byte of the content in the buffer; a multiple of 4. */
  offset: number;
  bytes: number;
}

const SECTION_HEADER = 12;

/** Returns the sections that follow `offset`. Throws BadBytes if they do not end where the buffer ends. */
export function readSections(view: DataView, offset: number, sections: number, what: string): Section[] {
  const found: Section[] = [];
  let at = offset;
  for (let index = 0; index < sections; index++) {
    if (at + SECTION_HEADER > view.byteLength) {
      throw new BadBytes(`${what}: section ${index} of ${sections} begins after the end, at byte ${at}`);
    }
    const kind = view.getUint32(at, true);
    const count = view.getUint32(at + 4, true);
    const bytes = view.getUint32(at + 8, true);
    at += SECTION_HEADER;
    if (bytes % 4 !== 0 || bytes > view.byteLength - at) {
      throw new BadBytes(
        `${what}: section ${index} (kind ${kind}) has ${bytes} bytes, and ${view.byteLength - at} are left`,
      );
    }
    found.push({ kind, count, offset: at, bytes });
    at += bytes;
  }
  if (at !== view.byteLength) throw new BadBytes(`${what}: ${view.byteLength - at} bytes follow the last section`);
  return found;
}

/** Returns a view of the buffer after its magic number was checked. */
export function openBuffer(buffer: ArrayBuffer, magic: number, header: number, what: string): DataView {
  const view = new DataView(buffer);
  if (view.byteLength < header)
    throw new BadBytes(`${what}: ${view.byteLength} bytes are less than a header of ${header}`);
  const found = view.getUint32(0, true);
  if (found !== magic)
    throw new BadBytes(`${what}: begins with ${found.toString(16)} in the place of ${magic.toString(16)}`);
  return view;
}

/** Throws BadBytes unless the section has exactly `needed` bytes, after padding to a multiple of 4. */
export function needBytes(section: Section, needed: number, what: string): void {
  const padded = Math.ceil(needed / 4) * 4;
  if (section.bytes !== padded) {
    throw new BadBytes(
      `${what}: section of kind ${section.kind} has ${section.bytes} bytes, but ${section.count} items need ${padded}`,
    );
  }
}

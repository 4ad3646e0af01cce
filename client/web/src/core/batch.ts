// Decodes the binary message of a frame: what moved, what is shown, what changed its colour or shape.
import { needBytes, openBuffer, readSections, type Section } from "./sections";

const BATCH_MAGIC = 0x55534c50;
const HASH_BYTES = 32;
/** The numbers of a matrix: rows 0 to 3, columns 0 to 2. */
export const MATRIX_SIZE = 12;

export interface Batch {
  matrices: { ids: Uint32Array; values: Float32Array }[];
  visibility: { ids: Uint32Array; visible: Uint8Array }[];
  colors: { ids: Uint32Array; values: Float32Array }[];
  geometry: { ids: Uint32Array; hashes: string[] }[];
  instances: { id: number; count: number; values: Float32Array; prototypes: Uint32Array }[];
}

/** Throws BadBytes if the message is damaged. Sections of unknown kinds are skipped. */
export function decodeBatch(buffer: ArrayBuffer): Batch {
  const view = openBuffer(buffer, BATCH_MAGIC, 8, "batch");
  const batch: Batch = { matrices: [], visibility: [], colors: [], geometry: [], instances: [] };
  for (const section of readSections(view, 8, view.getUint32(4, true), "batch")) decodeSection(buffer, section, batch);
  return batch;
}

function decodeSection(buffer: ArrayBuffer, section: Section, batch: Batch): void {
  const { kind, count, offset } = section;
  const idBytes = 4 * count;
  const floats = (start: number, length: number) => new Float32Array(buffer, start, length);
  const ids = () => new Uint32Array(buffer, offset, count);
  switch (kind) {
    case 1:
      needBytes(section, idBytes + 4 * MATRIX_SIZE * count, "batch, matrices");
      batch.matrices.push({ ids: ids(), values: floats(offset + idBytes, MATRIX_SIZE * count) });
      break;
    case 2:
      needBytes(section, idBytes + count, "batch, visibility");
      batch.visibility.push({ ids: ids(), visible: new Uint8Array(buffer, offset + idBytes, count) });
      break;
    case 3:
      needBytes(section, idBytes + 16 * count, "batch, colours");
      batch.colors.push({ ids: ids(), values: floats(offset + idBytes, 4 * count) });
      break;
    case 4: {
      needBytes(section, idBytes + HASH_BYTES * count, "batch, geometry");
      const hashes = Array.from({ length: count }, (_, index) =>
        hexOf(new Uint8Array(buffer, offset + idBytes + HASH_BYTES * index, HASH_BYTES)),
      );
      batch.geometry.push({ ids: ids(), hashes });
      break;
    }
    case 6: {
      needBytes(section, 4 + 4 * MATRIX_SIZE * count + 4 * count, "batch, instances");
      const values = floats(offset + 4, MATRIX_SIZE * count);
      const prototypes = new Uint32Array(buffer, offset + 4 + 4 * MATRIX_SIZE * count, count);
      batch.instances.push({ id: new DataView(buffer).getUint32(offset, true), count, values, prototypes });
      break;
    }
  }
}

/** Bytes as hexadecimal digits, which is how JSON and URLs name a hash. */
export function hexOf(bytes: Uint8Array): string {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

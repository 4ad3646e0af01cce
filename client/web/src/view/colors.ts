// Chooses colors that can be read on other colors.

/** Black or white, whichever is easier to read on the color "#rrggbb". */
export function textOn(color: string): string {
  const number = Number.parseInt(color.slice(1), 16);
  const channel = (shift: number) => {
    const value = ((number >> shift) & 255) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  };
  const luminance = 0.2126 * channel(16) + 0.7152 * channel(8) + 0.0722 * channel(0);
  return luminance > 0.18 ? "#000000" : "#ffffff";
}

// Colours of distances: cividis, which also those see who do not tell red from green (Nuñez,
// Anderton, Renslow, doi:10.1371/journal.pone.0199239), in eleven steps with straight lines between.

const STOPS = [0x00224e, 0x0f306d, 0x37476b, 0x515b6c, 0x696e71, 0x7f8176, 0x979676, 0xb1ac70, 0xcdc462, 0xe8dc4c, 0xfee838];

/** Red, green and blue from 0 to 1 for a share from 0 to 1. */
export function cividis(share: number): [number, number, number] {
  const place = Math.min(1, Math.max(0, share)) * (STOPS.length - 1);
  const low = Math.min(STOPS.length - 2, Math.floor(place));
  const channel = (shift: number) => {
    const [a, b] = [STOPS[low] ?? 0, STOPS[low + 1] ?? 0].map((stop) => ((stop >> shift) & 255) / 255) as [number, number];
    return a + (b - a) * (place - low);
  };
  return [channel(16), channel(8), channel(0)];
}

// How far the map lies from what instruments measured.

function navigationSection({ navigation }) {
  const { names, units, rows } = navigation;
  if (!rows.length) return [];
  const xs = rows.map((row) => row.scan);
  const charts = [["deg", "Attitude, map less instruments"], ["m", "Position, map less instruments"]].map(([unit, label]) => {
    const measured = names.map((_, k) => k).filter((k) => units[k] === unit && rows.some((row) => row.apart[k] !== null));
    return measured.length ? chart(label, unit, xs, measured.map((k) => ({ name: names[k], values: rows.map((row) => row.apart[k]) }))) : null;
  });
  const spread = (k) => {
    const known = rows.filter((row) => row.apart[k] !== null);
    const rms = (name) => Math.sqrt(known.reduce((total, row) => total + row[name][k] ** 2, 0) / known.length);
    return known.length ? [names[k], short(rms("apart"), units[k]), short(rms("sigmas"), units[k]), `${known.length}`] : null;
  };
  return [
    ...charts.filter(Boolean),
    table(["measured", "root mean square of the difference", "standard deviation it was given", "scans"],
      names.map((_, k) => spread(k)).filter(Boolean)),
  ];
}

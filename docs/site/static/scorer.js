/* What the search shows first: titles, then text, then objects of the API; the changelog last. */
var Scorer = {
  score: ([document, , , , score, , kind]) =>
    document === "CHANGELOG" ? score - 30 : kind === "object" ? score - 10 : score,
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};

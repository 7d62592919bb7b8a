# Prints each word or phrase of scripts/words.txt that a file uses, as FILE:LINE: message. Ends with 1 if there is one.
# The first file is the list; the comment at its top describes the columns.
function wrong(found, instead) { printf "%s:%d: \"%s\": write %s\n", FILENAME, FNR, found, instead; ++faults }
function trimmed(text) { gsub(/^ +| +$/, "", text); return text }
# Returns `text` without the parts in which entry `i` of the list is allowed.
function judged(text, i) {
  if (context[i] != "" && (only_in[i] == "" || FILENAME ~ only_in[i])) gsub(context[i], " ", text)
  return text
}

NR == FNR {
  if (/^#/ || !/\|/) next
  columns = split($0, column, / \| /)
  pattern = trimmed(column[1])
  is_id = sub(/^id /, "", pattern)
  i = is_id ? "id" ++ids : "text" ++texts
  shape[i] = "[^a-z](" pattern ")[^a-z]"
  instead[i] = trimmed(column[2])
  context[i] = columns > 2 ? tolower(trimmed(column[3])) : ""
  only_in[i] = columns > 3 ? trimmed(column[4]) : ""
  if (is_id) any_id = any_id (any_id == "" ? "" : "|") pattern
  else any_text = any_text (any_text == "" ? "" : "|") pattern
  next
}
{
  text = " " tolower($0) " "
  if (text ~ "[^a-z_](" any_text ")[^a-z_]")
    for (k = 1; k <= texts; ++k) {
      i = "text" k
      rest = judged(text, i)
      if (match(rest, shape[i])) wrong(trimmed(substr(rest, RSTART + 1, RLENGTH - 2)), instead[i])
    }
}
FILENAME ~ /\.(cpp|hpp|h|idl)$/ {
  line = $0
  gsub(/\\./, "", line)
  gsub(/"[^"]*"/, "\"\"", line)
  sub(/\/\/.*/, "", line)
  # A capital begins a word, so FreeSeat becomes free_seat. The k of a constant is not a word.
  words = ""
  while (match(line, /[a-z0-9][A-Z]/)) {
    words = words substr(line, 1, RSTART) (substr(line, 1, RSTART) ~ /(^|[^A-Za-z0-9_])k$/ ? " " : "_")
    line = substr(line, RSTART + 1)
  }
  words = " " tolower(words line) " "
  if (words ~ "[^a-z](" any_id ")[^a-z]")
    for (k = 1; k <= ids; ++k) {
      i = "id" k
      rest = judged(words, i)
      if (match(rest, shape[i])) wrong(trimmed(substr(rest, RSTART + 1, RLENGTH - 2)), instead[i] ", in names")
    }
}
END { exit faults > 0 }

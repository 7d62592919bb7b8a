# Prints each C++ name that breaks a rule, as FILE:LINE: message. The messages below state the rules. Ends with 1 when
# there is such a name. Reads declarations that begin and end on one line. Counts braces to find the members of classes.
function wrong(name, text) { printf "%s:%d: %s: %s\n", FILENAME, FNR, name, text; ++faults }
# The last word before the value, the bounds of an array or the end of a declaration.
function declared(text) {
  sub(/ *(=.*|\{.*|\[[^\]]*\];.*|;.*)$/, "", text)
  sub(/\[.*/, "", text)
  sub(/.*[^A-Za-z0-9_]/, "", text)
  return text
}

FNR == 1 {
  depth = 0
  split("", kind)
  name = FILENAME
  sub(/.*\//, "", name)
  if (name !~ /^[a-z0-9_]+\.(cpp|hpp)$/) wrong(name, "a file has a snake_case name")
}
/^#define / && !/^#define TACTUS_/ { wrong($2, "a macro begins with TACTUS_") }
/^ *(#|\/\/)/ { next }
{
  line = $0
  gsub(/\\./, "", line)
  gsub(/"[^"]*"/, "\"\"", line)
  gsub(/'.'/, "0", line)
  sub(/ *\/\/.*/, "", line)
  opens = ""
  text = line
  sub(/^ *(template <.*> )?/, "", text)
}
text ~ /^(class|struct|union|enum|enum class) (alignas\([^)]*\) )?[A-Za-z_0-9]+( final)?( :.*| ?\{.*)?$/ {
  opens = text ~ /^enum/ ? "enum" : text ~ /^class/ ? "class" : "struct"
  name = text
  sub(/^(enum class|enum|class|struct|union) (alignas\([^)]*\) )?/, "", name)
  sub(/[^A-Za-z0-9_].*/, "", name)
  if (name !~ /^([A-Z][A-Za-z0-9]*|tactus_[a-z_]+)$/) wrong(name, "a type has an UpperCamel name")
}
text ~ /^(static |inline )*constexpr [A-Za-z_:<>,0-9* ]+ [*]?[A-Za-z_0-9]+(\[[^\]]*\])*( =|\{)/ {
  name = declared(text)
  if (name !~ /^k[A-Z0-9]/) wrong(name, "a constant has a kCamel name")
}
text ~ /^(\[\[nodiscard\]\] |static |constexpr |inline |virtual |friend )*(const )?[A-Za-z_][A-Za-z0-9_:<>,]*( const)?[*&]* [*&]*[A-Za-z_0-9]+\(/ && text !~ /^(return|else|new|throw|delete|case|using|goto|explicit) / && text !~ /override|\) final \{|operator|^(constexpr |inline |explicit )+[A-Z][A-Za-z0-9]*\(/ {
  name = text
  sub(/\(.*/, "", name)
  sub(/.*[ *&]/, "", name)
  # A name in capitals is the call of a macro. The other exceptions are hooks of GoogleTest.
  if (name ~ /[A-Z]/ && name !~ /^([A-Z0-9_]+|SetUp.*|TearDown.*|PrintTo)$/) wrong(name, "a function or variable has a snake_case name")
}
text ~ /^enum [^{]*\{.*\};$/ {
  list = text
  gsub(/^[^{]*\{ *|,? *\};$/, "", list)
  count = split(list, item, / *, */)
  for (i = 1; i <= count; ++i)
    if (item[i] != "" && item[i] !~ /^k[A-Z0-9]/) wrong(item[i], "an enumerator has a kCamel name")
}
kind[depth] == "enum" && text ~ /^[A-Za-z_0-9]+( =.*)?,?$/ {
  name = declared(text)
  sub(/,.*/, "", name)
  if (text ~ /^[A-Za-z_0-9]+,?$/) { name = text; sub(/,$/, "", name) }
  if (name !~ /^k[A-Z0-9]/) wrong(name, "an enumerator has a kCamel name")
}
kind[depth] == "private" && !continues && text ~ /^[A-Za-z_].*[A-Za-z0-9_>&*] [*&]*[A-Za-z_0-9]+(\[[^\]]*\])*( = .*|\{.*\})?;$/ && text !~ /^(using|static|friend|typedef|return|struct|class|enum) / && text !~ /^[^={]*\(/ {
  name = declared(text)
  if (name !~ /_$/) wrong(name, "a member of a class ends in _")
}
{
  if (text ~ /^(private|protected):/ && kind[depth] ~ /class|private/) kind[depth] = "private"
  if (text ~ /^public:/ && kind[depth] ~ /class|private/) kind[depth] = "class"
  continues = text ~ /[,(=+&|?:<]$/ && text !~ /^(public|private|protected):/
  count = length(text)
  for (i = 1; i <= count; ++i) {
    c = substr(text, i, 1)
    if (c == "{") {
      kind[++depth] = opens == "class" ? "private" : opens
      opens = ""
    }
    if (c == "}" && depth > 0) --depth
  }
}
END { exit faults > 0 }

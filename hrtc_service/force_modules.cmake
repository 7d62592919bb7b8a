# The modules that hrtc_service links. A change of any file of these modules, or of hrtc_service, changes the build id
# of recordings. The list does not omit code without influence on forces, because nobody would notice a wrong omission.
set(force_modules spm spm/codec spm/fcl haptics session sharing trace wire)
